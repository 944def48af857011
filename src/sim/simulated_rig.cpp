#include "autocal_vio/sim/simulated_rig.h"

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {

CameraIntrinsics eurocIntrinsics() {
  CameraIntrinsics camera;
  camera.distortion_model = DistortionModel::kRadialTangential;
  camera.intrinsics << 458.654, 457.296, 367.215, 248.375;
  camera.distortion_coeffs << -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05;
  camera.width = 752;
  camera.height = 480;
  camera.sigma_principal_point = 0.0;
  return camera;
}

SimulatedRig randomRig(std::uint64_t seed, const RandomRigOptions& options) {
  RandomSource random(seed, 10);
  SimulatedRig result;
  result.rig.camera = eurocIntrinsics();
  result.rig.imu_noise = ImuNoise();
  const Eigen::Quaterniond R_BC = random.rotation();
  const Eigen::Vector3d direction = random.unitVector();
  result.T_imu_cam = Transform(R_BC, (direction * random.uniform(0.0, options.max_lever_arm)).eval());
  result.td = options.td;
  result.accelerometer_noise_factor = options.accelerometer_noise_factor;
  result.gyroscope_noise_factor = options.gyroscope_noise_factor;
  result.gyroscope_bias = random.unitVector();
  result.gyroscope_bias *= random.uniform(options.min_gyroscope_bias, options.max_gyroscope_bias);
  result.accelerometer_bias = random.unitVector();
  result.accelerometer_bias *= random.uniform(0.5, 1.0) * options.max_accelerometer_bias;
  return result;
}

}  // namespace autocal_vio
