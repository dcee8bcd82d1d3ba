//! The figures of merit of experiments.

/// Each figure of merit with its meaning, in the order of the columns of `results.csv`. Errors are over all evaluated
/// frames with an estimate.
pub const FIGURES_OF_MERIT: [(&str, &str); 47] = [
    (
        "coverage",
        "Share of the frames with the object visible that have an estimate.",
    ),
    (
        "on_target_share",
        "Share of the frames with the object visible that have an estimate no farther than `lost_beyond_m` from the truth.",
    ),
    (
        "lost_frames",
        "Frames with the object visible that have no estimate, or one farther than `lost_beyond_m` from the truth.",
    ),
    (
        "ends_on_target",
        "1 if the estimate is near the object in the last frame that shows it, otherwise 0.",
    ),
    (
        "frames_to_find",
        "Longest time, in frames, from when the object comes into view until an estimate is near it; 1 is the first frame.",
    ),
    (
        "frames_to_occluded",
        "Longest time, in frames, from the beginning of a full occlusion until the state is `occluded`.",
    ),
    (
        "frames_to_tracking",
        "Longest time, in frames, from the end of a full occlusion until the state is `tracking` near the object.",
    ),
    (
        "elsewhere_frames",
        "Frames in the state `tracking` with a position more than a diameter from the truth.",
    ),
    (
        "overconfident_frames",
        "Frames with a confidence above one half whose row is wrong.",
    ),
    ("mean_m", "Mean error of the position."),
    ("sd_m", "Standard deviation of the error of the position."),
    ("rmse_m", "Root mean square error of the position."),
    ("max_m", "Greatest error of the position."),
    (
        "best_rmse_m",
        "Root mean square error of the best particle's position.",
    ),
    (
        "distance_mean_m",
        "Mean error of the distance from the origin.",
    ),
    (
        "distance_sd_m",
        "Standard deviation of the error of the distance.",
    ),
    ("elevation_mean_rad", "Mean error of the elevation."),
    (
        "elevation_sd_rad",
        "Standard deviation of the error of the elevation.",
    ),
    ("azimuth_mean_rad", "Mean error of the azimuth."),
    (
        "azimuth_sd_rad",
        "Standard deviation of the error of the azimuth.",
    ),
    (
        "direction_max_rad",
        "Greatest angle between the estimated and the true direction.",
    ),
    (
        "mean_nees",
        "Mean normalised estimation error squared; 3 if the covariances are right, 2 on a plane.",
    ),
    (
        "nees_99_low",
        "Lower end of the 99 % confidence interval of that mean.",
    ),
    ("nees_99_high", "Upper end of that interval."),
    ("planar_mean_m", "Mean error of x and y."),
    ("planar_sd_m", "Standard deviation of the error of x and y."),
    ("planar_rmse_m", "Root mean square error of x and y."),
    ("bias_x_m", "Mean of the estimated minus the true x."),
    ("bias_y_m", "Mean of the estimated minus the true y."),
    ("bias_z_m", "Mean of the estimated minus the true z."),
    (
        "velocity_rmse_mps",
        "Root mean square error of the velocity.",
    ),
    (
        "velocity_nees",
        "Mean normalised estimation error squared of the velocity; 3 if its covariances are right, 2 on a plane.",
    ),
    (
        "course_error_median_rad",
        "Median error of the direction of travel, where the object moves at more than 0.2 m/s.",
    ),
    ("course_rad", "Mean estimated direction of travel there."),
    ("true_course_rad", "Mean true direction of travel there."),
    (
        "heading_error_median_rad",
        "Median magnitude of the error of the heading.",
    ),
    (
        "heading_error_p95_rad",
        "Magnitude of the error of the heading that 95 % of the estimates do not exceed.",
    ),
    ("heading_bias_rad", "Mean error of the heading."),
    (
        "changed_target",
        "1 if the track ends nearer to another object than to its own, otherwise 0.",
    ),
    (
        "calibration_error",
        "Mean difference between the confidence and the share of rows that are right.",
    ),
    ("confidence_max", "Highest confidence."),
    (
        "gospa_m",
        "Of a crowd: mean generalised optimal sub-pattern assignment metric with the cutoff `lost_beyond_m`, √(Σ d² + c²/2·(missed + false)).",
    ),
    (
        "switches",
        "Of a crowd: how often an object is followed by another member than before.",
    ),
    (
        "longest_missed_frames",
        "Of a crowd: the most frames in a row in which a visible object is followed by no member.",
    ),
    (
        "longest_false_frames",
        "Of a crowd: the most frames in a row in which a member follows no object.",
    ),
    ("estimates", "Number of evaluated frames with an estimate."),
    (
        "ms_a_frame",
        "Time per frame in milliseconds, of runs with `timed = true`.",
    ),
];
