#pragma once

namespace autocal_vio {

struct FeatureTrackerOptions {
  int max_features = 180;
  int pyramid_levels = 3;
  int patch_size = 21;
  double min_distance = 22.0;
  double min_contrast = 3.0;
  double min_correlation = 0.8;
  double max_correction = 1.0;
  double forward_backward_threshold = 0.7;
  double epipolar_threshold = 1.5;

  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("max_features", max_features, 20, 2000, "tracks kept per image [-]");
    visit("pyramid_levels", pyramid_levels, 0, 8, "pyramid levels above the base of the KLT tracker [-]");
    visit("patch_size", patch_size, 5, 61, "side of the KLT patch [px]");
    visit("min_distance", min_distance, 2, 200, "least distance between corners [px]");
    visit("min_contrast", min_contrast, 0.1, 100,
          "weakest corner: gradient in its weaker direction, root mean square [gray levels per px]");
    visit("min_correlation", min_correlation, 0, 0.999,
          "least correlation of a track with its first image, deformed to fit [-]");
    visit("max_correction", max_correction, 0.05, 20, "farthest from the flow to where that image fits [px]");
    visit("forward_backward_threshold", forward_backward_threshold, 0.05, 20,
          "largest forward-backward error, where most tracks do not fit their first image [px]");
    visit("epipolar_threshold", epipolar_threshold, 0.1, 20,
          "outlier threshold of the two-view geometry [px]");
  }
};

}  // namespace autocal_vio
