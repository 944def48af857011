// Two real calibrations for tests.
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

}  // namespace test
}  // namespace autocal_vio
