//! `tracks.csv`: one row per time and target, flushed immediately.

use std::fmt::Write as _;

use anyhow::Result;
use pardalis::Estimate;
use pardalis_scene::TargetConfig;

use super::{Instant, Output, Sink, is_broken_pipe};
use crate::files::RowFile;

/// The header line. Later versions may append columns.
pub(super) const HEADER: &str = "frame,time_s,target,state,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,heading_rad,\
                      xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2,ess,confidence,best_x_m,best_y_m,best_z_m,\
                      radius_m,sigma_radius_m,sigma_heading_rad,\
                      vxx_m2ps2,vxy_m2ps2,vxz_m2ps2,vyy_m2ps2,vyz_m2ps2,vzz_m2ps2\n";

/// Writes rows to a file or to standard output.
pub(crate) struct Rows {
    out: RowFile,
    targets: Vec<TargetConfig>,
    text: String,
}

impl Rows {
    /// Creates the file in the output folder and writes the header.
    pub(crate) fn create(output: &Output, targets: Vec<TargetConfig>) -> Result<Self> {
        let mut out = match output {
            Output::Stdout => RowFile::stdout(),
            Output::Folder(folder) => RowFile::create(&folder.join("tracks.csv"))?,
        };
        match out.write(HEADER) {
            // Writing the first row fails in the same way and ends the run quietly.
            Err(error) if is_broken_pipe(&error) => {}
            written => written?,
        }
        Ok(Self {
            out,
            targets,
            text: String::new(),
        })
    }
}

impl Sink for Rows {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.text.clear();
        for tracked in instant.tracked {
            let place = (instant.index, instant.time_s);
            let name = tracked.name(&self.targets);
            write_row(&mut self.text, place, &name, &tracked.estimate);
        }
        self.out.write(&self.text)
    }
}

/// Writes one row, with the number and the time in seconds of its frame set. Numbers are in the shortest form that parses to the same value; fields that do not apply are empty.
pub(super) fn write_row(
    text: &mut String,
    (index, time_s): (usize, f64),
    name: &str,
    estimate: &Estimate,
) {
    let state = estimate.state.name();
    let _ = write!(text, "{index},{time_s},{name},{state}");
    let kinematics = estimate.kinematics.as_ref();
    let position_m = kinematics.map(|k| k.position_m);
    let velocity_mps = kinematics.and_then(|k| k.velocity_mps);
    let covariance_m2 = kinematics.map(|k| k.covariance_m2);
    let velocity_covariance_m2ps2 = kinematics.and_then(|k| k.velocity_covariance_m2ps2);
    let fields = (0..3)
        .map(|axis| position_m.map(|p| p[axis]))
        .chain((0..3).map(|axis| velocity_mps.map(|v| v[axis])))
        .chain([estimate.heading_rad])
        .chain((0..6).map(|entry| covariance_m2.map(|c| c[entry])))
        .chain([
            kinematics.map(|k| k.effective_sample_size),
            Some(estimate.confidence),
        ])
        .chain((0..3).map(|axis| kinematics.map(|k| k.best_position_m[axis])))
        .chain([
            estimate.radius.map(|radius| radius.radius_m),
            estimate.radius.map(|radius| radius.sigma_m),
            estimate.heading_sigma_rad,
        ])
        .chain((0..6).map(|entry| velocity_covariance_m2ps2.map(|c| c[entry])));
    for field in fields {
        text.push(',');
        if let Some(value) = field {
            let _ = write!(text, "{value}");
        }
    }
    text.push('\n');
}
