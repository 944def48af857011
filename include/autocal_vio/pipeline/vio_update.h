// What VioSystem says after each image: a value, free of ROS.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/common/time.h"
#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

enum class VioState {
  kWaitingForData,
  kCalibratingRotation,
  kCalibratingTranslation,
  kEstimating,
  kConverged,
  kFrozen,
  kLost
};

/// The contract's name of a state: "waiting_for_data", ...
const char* toString(VioState state);

/// Motion state of the IMU body B in the odometry frame W (gravity along -z).
struct OdometryEstimate {
  TimeNs stamp_imu = 0;  ///< IMU clock: image stamp + td
  Transform T_odom_imu;
  Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();                     ///< [m/s]
  Eigen::Vector3d angular_velocity_B = Eigen::Vector3d::Zero();             ///< bias removed [rad/s]
  Matrix15d covariance = Matrix15d::Zero();                                 ///< of pose, velocity and biases
  Eigen::Matrix3d angular_velocity_covariance_B = Eigen::Matrix3d::Zero();  ///< [rad^2/s^2]
  TimeNs origin_stamp_imu = 0;  ///< where position and yaw count as known: covariances begin there
  Transform T_odom_origin;      ///< the pose there
};

/// Everything that is calibrated, each with one sigma; always finite. A sigma of 1e3: not estimated yet.
struct CalibrationEstimate {
  Transform T_imu_cam;                               ///< R_BC, p_BC
  Matrix6d covariance = Matrix6d::Identity() * 1e6;  ///< p_BC in B [m], then right perturbation of R_BC [rad]
  double td = 0.0;                                   ///< t_imu = t_cam + td [s]
  double sigma_td = 1e3;                             ///< [s]
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  ///< in B [rad/s]
  Eigen::Vector3d sigma_gyroscope_bias = Eigen::Vector3d::Constant(1e3);
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< in B [m/s^2]
  Eigen::Vector3d sigma_accelerometer_bias = Eigen::Vector3d::Constant(1e3);
  double scale = 0.0;                                 ///< metres per unit of the visual structure; 0: unknown
  double sigma_scale = 1e3;                           ///< relative: sigma of log(scale)
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();  ///< in the frame of the first keyframe's camera [m/s^2]
  double sigma_gravity_direction = 1e3;               ///< [rad], worst axis
  Eigen::Vector4d singular_values = Eigen::Vector4d::Zero();  ///< of Q_N, Eq. (8), descending
  std::array<bool, 3> rotation_observable{
      {false, false, false}};  ///< per axis of B: informed by motion so far
  std::array<bool, 3> translation_observable{{false, false, false}};  ///< per axis of B
  double accelerometer_noise_factor = 1.0;                            ///< estimated noise / rig file's [-]
  double gyroscope_noise_factor = 1.0;                                ///< estimated noise / rig file's [-]
  double pixel_sigma = 1.0;                                           ///< [px]
};

/// Parts of the calibration that are held.
struct FreezeSelection {
  bool rotation = false;
  bool translation = false;
  bool time_offset = false;

  bool any() const { return rotation || translation || time_offset; }
};

/// What is held, and how well that is known: "rotation (sigma 0.05 deg), translation (sigma 4 mm)".
std::string heldText(const FreezeSelection& held, const CalibrationEstimate& calibration);

/// CPU time of one image's stages [ms].
struct StageTimes {
  double tracking_ms = 0.0;
  double initialization_ms = 0.0;
  double optimization_ms = 0.0;
};

/// A tracked image point, for drawing.
struct TrackView {
  std::int64_t id = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  int age = 1;               ///< images it has been seen in
  bool in_estimate = false;  ///< used as a landmark by the estimator
};

/// Counters since start.
struct VioCounters {
  std::uint64_t images_processed = 0;
  std::uint64_t images_dropped = 0;    ///< refused or skipped, for whatever reason
  std::uint64_t images_uncovered = 0;  ///< of these: never covered by IMU samples
  std::uint64_t imu_unusable = 0;      ///< or beyond what any sensor can measure, or a glitch
  std::uint64_t imu_out_of_order = 0;
  std::uint64_t resets = 0;
};

struct VioUpdate {
  TimeNs stamp = 0;  ///< the image's stamp, camera clock
  VioState state = VioState::kWaitingForData;
  std::string reason;                        ///< one sentence: why it is in this state, what is missing
  std::string motion_advice;                 ///< which motion would help; empty when nothing is missing
  std::optional<OdometryEstimate> odometry;  ///< from the first estimate on
  CalibrationEstimate calibration;
  VioCounters counters;
  StageTimes times;
  int tracked_features = 0;
  std::vector<TrackView> tracks;
  std::vector<Eigen::Vector3d>
      landmarks_W;  ///< positions in the odometry frame [m], only those in the window
};

}  // namespace autocal_vio
