//! Projection of many points at once: vectorised in single precision for the kernels, and in double precision.

use super::{Camera, Pose, Projection};
use crate::with_model;
use nalgebra::Point3;
use pardalis_core::simd::Level;

/// Number of points per block.
pub const LANES: usize = 16;

impl Camera {
    /// Writes the pixels of points to the columns u, v. The points are given as columns x, y, z in
    /// the camera frame, in metres. Points outside the model's domain yield NaN.
    ///
    /// The pixels differ from those of [`Camera::project`] by less than 0.01 px (0.02 px for the
    /// exact mirror) in images of up to about 2000 px. All columns must have the same length.
    pub fn project_points(&self, level: Level, points: [&[f32]; 3], pixels: [&mut [f32]; 2]) {
        let [u, v] = pixels;
        let count = u.len();
        assert!(
            v.len() == count && points.iter().all(|column| column.len() == count),
            "all columns must have the same length"
        );
        with_model!(self, model => {
            let model = model.to_f32();
            level.run(
                #[inline(always)]
                || project_columns(&model, points, [u, v]),
            );
        });
    }

    /// Writes the pixels of points in double precision. The points are given as rows x, y, z in the frame from which the pose leads to the
    /// camera frame, in metres. Points outside the model's domain yield NaN.
    ///
    /// The pixels are those of [`Camera::project`], to the bit. There must be as many as points.
    pub fn project_rows(
        &self,
        level: Level,
        camera_from_world: &Pose,
        points_m: &[[f64; 3]],
        pixels: &mut [[f64; 2]],
    ) {
        assert_eq!(points_m.len(), pixels.len(), "as many pixels as points");
        with_model!(self, model => level.run(
            #[inline(always)]
            || {
                for (point_m, pixel) in points_m.iter().zip(pixels) {
                    let in_camera = camera_from_world * Point3::from(*point_m);
                    let (found, valid) = model.project(in_camera.into());
                    *pixel = if valid { found } else { [f64::NAN; 2] };
                }
            },
        ));
    }
}

#[inline(always)]
fn project_columns<P: Projection<f32>>(model: &P, points: [&[f32]; 3], [u, v]: [&mut [f32]; 2]) {
    let blocks = points.map(|column| column.as_chunks::<LANES>());
    let (u_blocks, u_rest) = u.as_chunks_mut::<LANES>();
    let (v_blocks, v_rest) = v.as_chunks_mut::<LANES>();
    for i in 0..u_blocks.len() {
        [u_blocks[i], v_blocks[i]] = project_block(model, &blocks.map(|(blocks, _)| blocks[i]));
    }
    let last = blocks.map(|(_, rest)| {
        let mut lanes = [0.0; LANES];
        lanes[..rest.len()].copy_from_slice(rest);
        lanes
    });
    let [last_u, last_v] = project_block(model, &last);
    u_rest.copy_from_slice(&last_u[..u_rest.len()]);
    v_rest.copy_from_slice(&last_v[..v_rest.len()]);
}

/// Returns the pixels of a block of points, NaN for points outside the domain. The selection is a
/// loop of its own: within the first loop, the compiler would branch instead of vectorise.
#[inline(always)]
pub fn project_block<P: Projection<f32>>(
    model: &P,
    [x, y, z]: &[[f32; LANES]; 3],
) -> [[f32; LANES]; 2] {
    let (mut u, mut v, mut valid) = ([0.0; LANES], [0.0; LANES], [false; LANES]);
    for lane in 0..LANES {
        ([u[lane], v[lane]], valid[lane]) = model.project([x[lane], y[lane], z[lane]]);
    }
    for lane in 0..LANES {
        u[lane] = if valid[lane] { u[lane] } else { f32::NAN };
        v[lane] = if valid[lane] { v[lane] } else { f32::NAN };
    }
    [u, v]
}
