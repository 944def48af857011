// Scale, gravity, camera-IMU translation and accelerometer bias from an up-to-scale visual trajectory and the
// preintegrated IMU, Eq. (13)-(20) of the paper.
//
// Frame V is the visual structure's frame: the paper's W, before gravity is known. W has gravity along -z:
// the paper's E. p_CB is the paper's p^C_B (IMU in the camera frame); the public face is p_BC = -R_BC p_CB.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "autocal_vio/common/time.h"
#include "autocal_vio/imu/preintegration.h"

namespace autocal_vio {

/// Camera pose of one keyframe in the visual structure.
struct AlignmentKeyframe {
  TimeNs stamp = 0;  ///< IMU clock
  Eigen::Quaterniond R_VC = Eigen::Quaterniond::Identity();
  Eigen::Vector3d p_VC = Eigen::Vector3d::Zero();  ///< up to scale [structure units]
};

/// What is aligned: N keyframes, the N - 1 preintegrations between them (gyroscope bias already corrected,
/// any linearisation accelerometer bias), and the camera-IMU rotation. Referenced, not copied.
struct AlignmentInput {
  const std::vector<AlignmentKeyframe>& keyframes;
  const std::vector<Preintegration>& preintegrations;
  Eigen::Quaterniond R_BC;
};

/// Solution of Eq. (14): no accelerometer bias, gravity of any magnitude.
struct ApproximateAlignment {
  std::string failure;                             ///< why there is no solution; empty on success
  double scale = 0.0;                              ///< s [m per structure unit]
  Eigen::Vector3d g_V = Eigen::Vector3d::Zero();   ///< gravity [m/s^2]
  Eigen::Vector3d p_CB = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Vector3d p_BC = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::VectorXd singular_values;                 ///< 7, descending, of the system with unit columns [-]
  double condition = 0.0;                          ///< largest / smallest singular value
  double rms_residual = 0.0;                       ///< of the equations divided to accelerations [m/s^2]
  double sigma_scale = 0.0;                        ///< relative, from the residuals [-]

  bool ok() const { return failure.empty(); }
};

/// Noise model and priors of the weighted refinement.
struct AlignmentNoise {
  double sigma_position = 0.0;                           ///< of p_VC, per axis, independent [structure units]
  double sigma_rotation = 0.0;                           ///< of R_VC, per axis, independent [rad]
  double sigma_accelerometer_bias = 0.3;                 ///< prior, zero mean; 0: none [m/s^2]
  Eigen::Vector3d prior_p_BC = Eigen::Vector3d::Zero();  ///< [m]
  double sigma_p_BC = 0.0;                               ///< of prior_p_BC, per axis; 0: no prior [m]
};

struct AlignmentOptions {
  double gravity = 9.81;                ///< magnitude [m/s^2]
  int max_iterations = 30;              ///< relinearisations of the gravity direction
  double step_tolerance = 1e-9;         ///< converged when no scaled unknown moves by more [-]
  double max_sigma_scale = 0.5;         ///< refused above this relative sigma of the scale [-]
  std::optional<AlignmentNoise> noise;  ///< absent: the paper's unweighted least squares, no priors
};

/// Solution of Eq. (19), iterated.
struct Alignment {
  std::string failure;                                       ///< why there is no solution; empty on success
  double scale = 0.0;                                        ///< s [m per structure unit]
  Eigen::Quaterniond R_VW = Eigen::Quaterniond::Identity();  ///< the paper's R_WE; its yaw is arbitrary
  Eigen::Vector3d g_V = Eigen::Vector3d::Zero();             ///< R_VW (0, 0, -gravity) [m/s^2]
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  ///< total, not the correction [m/s^2]
  Eigen::Vector3d p_CB = Eigen::Vector3d::Zero();                ///< [m]
  Eigen::Vector3d p_BC = Eigen::Vector3d::Zero();                ///< [m]

  /// Order: scale [m per unit], gravity direction about x and y of W [rad], accelerometer bias [m/s^2], p_BC
  /// [m]. Weighted: inverse information, times chi^2 per degree of freedom where that exceeds 1. Unweighted:
  /// from the residuals, which takes the overlapping equations for independent and is therefore only a rough
  /// guide.
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
  double sigma_scale = 0.0;                              ///< relative [-]
  double sigma_gravity = 0.0;                            ///< direction, worst axis [rad]
  Eigen::Vector3d sigma_bias = Eigen::Vector3d::Zero();  ///< [m/s^2]
  Eigen::Vector3d sigma_p_BC = Eigen::Vector3d::Zero();  ///< [m]

  Eigen::VectorXd singular_values;  ///< 9, descending, of the (weighted) system with unit columns [-]
  double condition = 0.0;
  double rms_residual = 0.0;  ///< [m/s^2]
  double chi2_per_dof = 0.0;  ///< weighted only: near 1 where the noise model holds [-]
  int iterations = 0;

  bool ok() const { return failure.empty(); }
};

/// Eq. (13)-(15) by SVD. Fails below 5 keyframes, on input that does not fit together, and on a singular
/// system (standstill, constant velocity, no rotation); the reason says which.
ApproximateAlignment approximateScaleGravityTranslation(const AlignmentInput& input,
                                                        double max_sigma_scale = 0.5);

/// Eq. (16)-(20): gravity of known magnitude, accelerometer bias; Gauss-Newton from `start`, the gravity
/// direction relinearised until nothing moves. With `options.noise` the equations are weighted by their full
/// covariance (preintegration and visual poses, neighbouring equations share both) and the visual poses are
/// estimated too, which removes the pull towards small scales that noise in lambda(i) exerts on the plain
/// least squares.
Alignment refineWithAccelerometerBias(const AlignmentInput& input, const ApproximateAlignment& start,
                                      const AlignmentOptions& options);

/// Velocity of the IMU at every keyframe, in V [m/s], from Eq. (13): each the best mean of what the intervals
/// before and after it say. `input` and `alignment` belong together.
std::vector<Eigen::Vector3d> keyframeVelocities(const AlignmentInput& input, const Alignment& alignment);

}  // namespace autocal_vio
