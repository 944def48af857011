#pragma once

namespace autocal_vio {

struct InitializerOptions {
  double keyframe_interval = 0.2;
  int max_keyframes = 30;
  int min_keyframes = 8;
  double attempt_interval = 0.5;
  double max_sigma_scale = 0.03;
  double relaxed_max_sigma_scale = 0.06;
  double scale_patience = 4.0;
  bool in_background =
      false;  ///< attempts run beside the images that come; results depend on its speed (no file key)

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("keyframe_interval", keyframe_interval, 0.02, 2, "time between keyframes of the structure [s]");
    visit("max_keyframes", max_keyframes, 6, 200, "keyframes of the structure, the newest [-]");
    visit("min_keyframes", min_keyframes, 5, 200, "keyframes before the first attempt [-]");
    visit("attempt_interval", attempt_interval, 0.05, 10,
          "least time between attempts, 2 s while the scale is far from known [s]");
    visit("max_sigma_scale", max_sigma_scale, 0.001, 0.5,
          "odometry starts below this relative sigma of the scale [-]");
    visit("relaxed_max_sigma_scale", relaxed_max_sigma_scale, 0.001, 0.5,
          "the same where the extrinsics were given, or kept from before, or after scale_patience [-]");
    visit("scale_patience", scale_patience, 0, 1e6,
          "waits so long for max_sigma_scale after the first batch [s]");
  }
};

}  // namespace autocal_vio
