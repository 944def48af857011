// Calibrations for tests.
#pragma once

#include "autocal_vio/camera/camera_model.h"

namespace autocal_vio {
namespace test {

/// EuRoC MAV, cam0.
inline CameraIntrinsics eurocIntrinsics() {
  CameraIntrinsics c;
  c.distortion_model = DistortionModel::kRadialTangential;
  c.intrinsics << 458.654, 457.296, 367.215, 248.375;
  c.distortion_coeffs << -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05;
  c.width = 752;
  c.height = 480;
  return c;
}

/// TUM VI at 512x512, cam0: a fisheye lens that sees more than a half space in the image's corners.
inline CameraIntrinsics tumViIntrinsics() {
  CameraIntrinsics c;
  c.distortion_model = DistortionModel::kEquidistant;
  c.intrinsics << 190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504;
  c.distortion_coeffs << 0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202,
      0.00020293673591811182;
  c.width = 512;
  c.height = 512;
  return c;
}

/// A webcam as ROS's camera_calibration describes it: plumb_bob, five coefficients.
inline CameraIntrinsics plumbBobIntrinsics() {
  CameraIntrinsics c;
  c.intrinsics << 510.2, 511.7, 325.4, 243.9;
  c.distortion_coeffs << 0.0812, -0.1927, 0.0011, -0.0023;
  c.higher_radial_coeffs << 0.0915, 0.0, 0.0, 0.0;
  c.width = 640;
  c.height = 480;
  return c;
}

/// A wide lens with a rational radial factor: all eight coefficients.
inline CameraIntrinsics rationalIntrinsics() {
  CameraIntrinsics c;
  c.intrinsics << 388.3, 387.9, 323.1, 197.2;
  c.distortion_coeffs << 0.4215, 0.1187, 0.00041, -0.00018;
  c.higher_radial_coeffs << 0.0073, 0.7462, 0.2511, 0.0302;
  c.width = 640;
  c.height = 400;
  return c;
}

}  // namespace test
}  // namespace autocal_vio
