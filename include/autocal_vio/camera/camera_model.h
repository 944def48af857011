// Pinhole cameras with radial-tangential (also rational) or equidistant (fisheye) distortion.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace autocal_vio {

enum class DistortionModel { kRadialTangential, kEquidistant };

/// What a calibration file says about a camera. Kalibr's names and orders.
struct CameraIntrinsics {
  DistortionModel distortion_model = DistortionModel::kRadialTangential;
  Eigen::Vector4d intrinsics = Eigen::Vector4d::Zero();         ///< fu fv pu pv [px]
  Eigen::Vector4d distortion_coeffs = Eigen::Vector4d::Zero();  ///< k1 k2 p1 p2, or k1 k2 k3 k4 [-]
  /// k3 k4 k5 k6 of the radial-tangential model as OpenCV and ROS have it (plumb_bob, rational_polynomial): the radial
  /// factor is (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6). Zero in Kalibr's radtan [-].
  Eigen::Vector4d higher_radial_coeffs = Eigen::Vector4d::Zero();
  int width = 0;   ///< [px]
  int height = 0;  ///< [px]
  /// How well the principal point is known [px]. An error of it turns the camera much as a wrong R_BC
  /// would: the published sigma of R_BC has to hold it.
  double sigma_principal_point = 0.5;
  /// Of a rolling shutter, from the first row to the last; stamps are the middle row's [s]; 0: a global one.
  double readout_time = 0.0;

  /// Everything that is wrong with the values, one sentence each; empty when usable.
  std::vector<std::string> validate() const;
};

/// Projection and its inverse. Camera frame C: z forward, x right, y down (REP 103 optical frame).
class CameraModel {
 public:
  /// Throws std::invalid_argument listing every violation of CameraIntrinsics::validate().
  explicit CameraModel(const CameraIntrinsics& intrinsics);

  /// Projects a point in C [m] to a pixel. False (outputs untouched) when the point is not in front of the
  /// camera or so far off axis that the distortion polynomial no longer describes the lens.
  /// `J`: d pixel / d point_C, 2x3 [px/m].
  bool project(const Eigen::Vector3d& point_C, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* J = nullptr) const;

  /// Distorts normalised coordinates (x/z, y/z) to a pixel; `J`: d pixel / d normalised, 2x2 [px].
  bool distort(const Eigen::Vector2d& normalized, Eigen::Vector2d* pixel, Eigen::Matrix2d* J = nullptr) const;

  /// Undistorts a pixel to normalised coordinates (x/z, y/z) by Newton iteration; nothing when it does not
  /// converge (a pixel outside the lens model's valid region).
  std::optional<Eigen::Vector2d> undistort(const Eigen::Vector2d& pixel) const;

  /// True when the pixel lies in the image, at least `border` px from its edge.
  bool contains(const Eigen::Vector2d& pixel, double border = 0.0) const;

  int width() const { return intrinsics_.width; }
  int height() const { return intrinsics_.height; }
  /// Mean focal length [px]; turns normalised errors into pixels at the image centre.
  double focalLength() const { return 0.5 * (intrinsics_.intrinsics(0) + intrinsics_.intrinsics(1)); }
  const CameraIntrinsics& intrinsics() const { return intrinsics_; }

 private:
  bool distortNormalized(const Eigen::Vector2d& normalized, Eigen::Vector2d* distorted,
                         Eigen::Matrix2d* J) const;

  CameraIntrinsics intrinsics_;
  double max_radius_squared_;  ///< largest normalised radius^2 up to which the distortion is monotonic
};

}  // namespace autocal_vio
