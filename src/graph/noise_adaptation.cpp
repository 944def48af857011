#include "autocal_vio/graph/noise_adaptation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Matrix9x30d = Eigen::Matrix<double, 9, 30>;

constexpr int kNoiseRounds = 3;  // of a batch: each may change the variance by kLargestRatio
constexpr double kRoundTolerance =
    1e-3;  // relative change of the cost: rounds before the last need not be exact
constexpr double kFinalTolerance = 1e-5;
constexpr int kEnoughObservations = 100;
constexpr double kMinPixelSigma = 0.3;  // [px] tracks are correlated in time: never trust them more
constexpr double kMaxPixelSigma = 3.0;  // [px]
constexpr double kFade = 0.97;          // per update: evidence lives for some 30 intervals
constexpr double kPriorEvidence = 0.5;  // degrees of freedom that speak for the factors staying
constexpr double kLargestRatio = 9.0;   // of the variance, in one update
constexpr double kOutlierRatio = 25.0;  // an interval further out than this is no noise but a fault

// Residual [p, theta, v] of an interval and its Jacobian by both frames' tangents [pose_i motion_i pose_j motion_j].
void intervalResidual(const FrameState& i, const FrameState& j, const Eigen::Vector3d& g, Vector9d* r,
                      Matrix9x30d* A) {
  const Preintegration& pre = *j.preintegration;
  const double dt = pre.duration();
  const Eigen::Matrix3d R_iT = i.rotation().conjugate().toRotationMatrix();
  const ImuIncrement increment = pre.corrected(i.bias());
  const Eigen::Vector3d dp = R_iT * (j.position() - i.position() - i.velocity() * dt - 0.5 * g * dt * dt);
  const Eigen::Vector3d dv = R_iT * (j.velocity() - i.velocity() - g * dt);
  const Eigen::Vector3d theta =
      logSo3(increment.rotation.conjugate() * i.rotation().conjugate() * Eigen::Quaterniond(j.rotation()));
  *r << dp - increment.position, theta, dv - increment.velocity;
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  A->setZero();
  // Small residuals: Jr^-1(theta) = I.
  A->block<3, 3>(0, 0) = -R_iT;
  A->block<3, 3>(0, 3) = skew(dp);
  A->block<3, 3>(0, 6) = -dt * R_iT;
  A->block<3, 3>(0, 9) = -pre.positionByGyroBias();
  A->block<3, 3>(0, 12) = -pre.positionByAccelBias();
  A->block<3, 3>(0, 15) = R_iT;
  A->block<3, 3>(3, 3) = -(j.rotation().conjugate() * Eigen::Quaterniond(i.rotation())).toRotationMatrix();
  A->block<3, 3>(3, 9) = -pre.rotationByGyroBias();
  A->block<3, 3>(3, 18) = I;
  A->block<3, 3>(6, 3) = skew(dv);
  A->block<3, 3>(6, 6) = -R_iT;
  A->block<3, 3>(6, 9) = -pre.velocityByGyroBias();
  A->block<3, 3>(6, 12) = -pre.velocityByAccelBias();
  A->block<3, 3>(6, 21) = R_iT;
}

// Covariance of [p, theta, v] with only some of the noise switched on.
Matrix9d componentCovariance(const Preintegration& pre, double gyro_density, double accel_density) {
  ImuNoise noise = pre.noise();
  noise.gyroscope_noise_density = gyro_density;
  noise.accelerometer_noise_density = accel_density;
  noise.gyroscope_random_walk = noise.accelerometer_random_walk = 0.0;
  return Preintegration(pre.samples(), pre.linearizationBias(), noise).covariance().topLeftCorner<9, 9>();
}

double updatedFactor(double factor, double observed, double expected, double largest) {
  const double ratio = std::clamp((observed + kPriorEvidence) / (expected + kPriorEvidence),
                                  1.0 / kLargestRatio, kLargestRatio);
  return std::clamp(factor * std::sqrt(ratio), 1.0, largest);
}

}  // namespace

ImuNoise scaled(const ImuNoise& noise, const NoiseFactors& factors) {
  ImuNoise result = noise;
  result.accelerometer_noise_density *= factors.accelerometer;
  result.gyroscope_noise_density *= factors.gyroscope;
  return result;
}

void NoiseAdaptation::addInterval(const VisualInertialGraph& graph, const GraphCovariance& covariance,
                                  std::size_t index) {
  const FrameState &i = graph.frames()[index - 1], &j = graph.frames()[index];
  Vector9d r;
  Matrix9x30d A;
  intervalResidual(i, j, graph.gravity_W(), &r, &A);
  Eigen::Matrix<double, 30, 30> P;
  const BlockKey keys[4] = {{i.id, BlockKind::kPose},
                            {i.id, BlockKind::kMotion},
                            {j.id, BlockKind::kPose},
                            {j.id, BlockKind::kMotion}};
  const int offsets[4] = {0, 6, 15, 21};
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b)
      P.block(offsets[a], offsets[b], tangentSize(keys[a].kind), tangentSize(keys[b].kind)) =
          covariance.block(keys[a], keys[b]);

  const Preintegration& pre = *j.preintegration;
  const Matrix9d C = pre.covariance().topLeftCorner<9, 9>();
  const Matrix9d C_inverse = C.llt().solve(Matrix9d::Identity());
  const Matrix9d unabsorbed = C - A * P * A.transpose();
  const auto add = [&](const Matrix9d& component, Evidence* evidence) {
    const Matrix9d M = C_inverse * component * C_inverse;
    const double observed = r.dot(M * r), expected = (M * unabsorbed).trace();
    if (!std::isfinite(observed) || !std::isfinite(expected) || expected <= 0.0) return;
    evidence->observed += std::min(observed, kOutlierRatio * expected);
    evidence->expected += expected;
  };
  add(componentCovariance(pre, 0.0, pre.noise().accelerometer_noise_density), &accelerometer_);
  add(componentCovariance(pre, pre.noise().gyroscope_noise_density, 0.0), &gyroscope_);
}

std::optional<double> fittedPixelSigma(const VisualInertialGraph& graph) {
  int count = 0;
  const double fitted = graph.pixelSigma(&count);
  if (count < kEnoughObservations) return std::nullopt;
  // A landmark of n observations leaves 2n - 3 of 2n degrees of freedom: 0.75 of them at n = 6.
  return std::clamp(fitted / std::sqrt(0.75), kMinPixelSigma, kMaxPixelSigma);
}

std::string solveAdaptingNoise(int max_iterations, double outlier_px, VisualInertialGraph* graph,
                               NoiseAdaptation* noise) {
  for (int round = 0; round < kNoiseRounds; ++round) {
    if (!graph->solve(max_iterations, kRoundTolerance).usable) return "the bundle adjustment failed";
    graph->dropOutliers(outlier_px);
    if (const std::optional<double> fitted = fittedPixelSigma(*graph)) graph->options().pixel_sigma = *fitted;
    const std::optional<GraphCovariance> covariance = graph->covariance();
    if (!covariance) return "scale and gravity are not determined yet";
    for (std::size_t i = 1; i < graph->frames().size(); ++i) noise->addInterval(*graph, *covariance, i);
    noise->update();
    for (FrameState& frame : graph->frames())
      if (frame.preintegration) frame.preintegration->repropagate(frame.bias(), noise->noise());
  }
  return graph->solve(max_iterations, kFinalTolerance).usable ? "" : "the bundle adjustment failed";
}

void NoiseAdaptation::update() {
  const NoiseFactors before = factors_;
  factors_.accelerometer =
      updatedFactor(before.accelerometer, accelerometer_.observed, accelerometer_.expected, largest_);
  factors_.gyroscope = updatedFactor(before.gyroscope, gyroscope_.observed, gyroscope_.expected, largest_);
  // The evidence was gathered at the old factors: carry it over to the new ones.
  const double a = std::pow(before.accelerometer / factors_.accelerometer, 2);
  const double g = std::pow(before.gyroscope / factors_.gyroscope, 2);
  accelerometer_.observed *= kFade * a;
  accelerometer_.expected *= kFade;
  gyroscope_.observed *= kFade * g;
  gyroscope_.expected *= kFade;
}

}  // namespace autocal_vio
