// What a track looked like where it was first seen, to find that same point again in later images.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>

namespace autocal_vio {

/// KLT from image to image takes each image's patch for the next one's template, so its errors add up: after two
/// seconds a track has slid off its point by a pixel. Fitting the first image's patch with an affine deformation,
/// gain and offset (Shi and Tomasi 1994; solved as in Baker and Matthews 2004, inverse compositional) has no such sum.
class ReferencePatch {
 public:
  static constexpr int kRadius = 7;              ///< [px]
  static constexpr int kSide = 2 * kRadius + 1;  ///< [px]
  static constexpr int kPixels = kSide * kSide;

  struct Fit {
    cv::Point2f pixel;                                          ///< where the reference's centre is now
    float correlation = 0.0F;                                   ///< normalised, of the deformed patch [-1, 1]
    Eigen::Matrix2f deformation = Eigen::Matrix2f::Identity();  ///< from the reference to the image
  };

  /// The patch about `pixel` of `image` (CV_8UC1). Nothing where it leaves the image or has too little texture to
  /// determine a deformation.
  static std::optional<ReferencePatch> cut(const cv::Mat& image, const cv::Point2f& pixel);

  /// Finds the patch in `image` near `guess`, beginning with `deformation`. Nothing when the fit does not settle or leaves
  /// the image.
  std::optional<Fit> find(const cv::Mat& image, const cv::Point2f& guess,
                          const Eigen::Matrix2f& deformation) const;

 private:
  using Pixels = Eigen::Matrix<float, kPixels, 1>;

  ReferencePatch() = default;

  Pixels appearance_;                          ///< zero mean, unit norm
  Eigen::Matrix<float, 6, kPixels> response_;  ///< least-squares step of [shift, deformation] per residual
};

/// Largest and smallest magnification of a deformation.
Eigen::Vector2f magnificationOf(const Eigen::Matrix2f& deformation);

}  // namespace autocal_vio
