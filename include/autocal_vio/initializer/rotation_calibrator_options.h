#pragma once

namespace autocal_vio {

struct RotationCalibratorOptions {
  double threshold = 1.5;
  int min_tracks = 30;
  double min_span = 0.15;
  double max_span = 0.4;
  double pair_interval = 0.1;
  int max_pairs = 150;
  int min_pairs = 10;
  double solve_interval = 0.25;
  double hand_eye_threshold_deg = 5.0;
  double max_sigma_deg = 0.5;
  double min_second_axis_deg = 5.0;
  double max_residual_scale = 8.0;
  double correlation_factor = 2.0;
  double sigma_floor_deg = 0.03;
  double sigma_gyroscope_bias = 0.2;

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("threshold", threshold, 0.1, 20, "outlier threshold of the two-view geometry [px]");
    visit("min_tracks", min_tracks, 15, 1000, "common tracks a pair of images needs [-]");
    visit("min_span", min_span, 0.02, 2, "shortest time between the images of a pair [s]");
    visit("max_span", max_span, 0.05, 5, "longest time between the images of a pair [s]");
    visit("pair_interval", pair_interval, 0.01, 2, "time between the ends of pairs [s]");
    visit("max_pairs", max_pairs, 10, 2000, "pairs kept, the most informative [-]");
    visit("min_pairs", min_pairs, 3, 1000, "pairs before the first estimate [-]");
    visit("solve_interval", solve_interval, 0.02, 10, "time between estimates [s]");
    visit("hand_eye_threshold_deg", hand_eye_threshold_deg, 0.1, 90, "t0 of Eq. (10) [deg]");
    visit("max_sigma_deg", max_sigma_deg, 0.01, 20, "R_BC is accepted below this sigma, worst axis [deg]");
    visit("min_second_axis_deg", min_second_axis_deg, 0.5, 180,
          "rotation about the second axis, root of the sum of squares over pairs [deg]");
    visit("max_residual_scale", max_residual_scale, 1, 1000,
          "largest ratio of residuals to their covariance [-]");
    visit("correlation_factor", correlation_factor, 1, 100,
          "variance of a pair over what independent noise would give: pairs overlap, tracks drift [-]");
    visit("sigma_floor_deg", sigma_floor_deg, 0, 5, "error that no number of pairs removes [deg]");
    visit("sigma_gyroscope_bias", sigma_gyroscope_bias, 1e-4, 10,
          "prior of the gyroscope bias, about zero [rad/s]");
  }
};

}  // namespace autocal_vio
