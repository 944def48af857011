#include "autocal_vio/graph/noise_adaptation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Matrix9x30d = Eigen::Matrix<double, 9, 30>;

constexpr int kNoiseRounds = 4;        // of a batch, at most: each may change the variance by kLargestRatio
constexpr double kFactorChange = 0.2;  // relative, below which the rounds end
constexpr double kRoundTolerance =
    1e-3;  // relative change of the cost: rounds before the last need not be exact
constexpr double kFinalTolerance = 1e-5;
constexpr int kEnoughObservations = 100;
constexpr double kMinPixelSigma = 0.3;  // [px] tracks are correlated in time: never trust them more
constexpr double kMaxPixelSigma = 3.0;  // [px]
constexpr double kFade = 0.99;          // per update: evidence lives for some 100 intervals
// What is known beforehand of [accelerometer, gyroscope] in motion: vibration makes 12 and 2.3 times the data sheet's noise
// of them on a real drone. A log-normal prior this wide leaves the data sheet within 2.5 and 1.7 sigma. Without it a batch
// of a second that shows little of either took a vibrating IMU for a quiet one, and was sure of what came out.
const Eigen::Array2d kTypicalFactors(12.0, 2.3);
const Eigen::Array2d kLogVarianceSigma(2.0, 1.0);
constexpr double kDamping = 0.7;  // neighbouring intervals are correlated, which the information leaves out
constexpr double kLargestRatio = 9.0;        // of the variance, in one update
constexpr double kSmallestTotal = 0.01;      // of what rounding may leave of a variance's share
constexpr double kLeastExpected = 1e-3;      // degrees of freedom, below which rounding decides
constexpr std::size_t kRecentIntervals = 5;  // of which two may be faults of their own
constexpr double kOutlierRatio = 25.0;       // an interval further out than this is no noise but a fault

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

// Of [accelerometer, gyroscope]: variances over the nominal ones with which the interval was integrated.
Eigen::Vector2d variancesWithin(const Preintegration& pre, const ImuNoise& nominal) {
  const Eigen::Array2d densities(pre.noise().accelerometer_noise_density,
                                 pre.noise().gyroscope_noise_density);
  const Eigen::Array2d nominals(nominal.accelerometer_noise_density, nominal.gyroscope_noise_density);
  return (densities / nominals).square().matrix();
}

// Covariance of [p, theta, v] with only some of the noise switched on.
Matrix9d componentCovariance(const Preintegration& pre, double gyro_density, double accel_density) {
  ImuNoise noise = pre.noise();
  noise.gyroscope_noise_density = gyro_density;
  noise.accelerometer_noise_density = accel_density;
  noise.gyroscope_random_walk = noise.accelerometer_random_walk = 0.0;
  return Preintegration(pre.samples(), pre.linearizationBias(), noise).covariance().topLeftCorner<9, 9>();
}

constexpr double kRayleighMedian = 1.17741;  // of the length of a 2-vector with unit normal components

bool isClose(double before, double after) {
  return std::abs(after - before) < kFactorChange * before;
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
  if (j.preintegration->longestGap() > 0.0) return;  // it shows how the rig has moved meanwhile
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
  const Matrix9d U = C - A * P * A.transpose();  // what the estimate leaves of C in the residual
  const Matrix9d M[2] = {
      C_inverse * componentCovariance(pre, 0.0, pre.noise().accelerometer_noise_density) * C_inverse,
      C_inverse * componentCovariance(pre, pre.noise().gyroscope_noise_density, 0.0) * C_inverse};
  Evidence evidence;
  Eigen::Vector2d shown;
  for (int k = 0; k < 2; ++k) {
    const double expected = (M[k] * U).trace(), observed = r.dot(M[k] * r);
    if (!(expected > 0.0) || !std::isfinite(observed)) return;
    shown(k) = observed / expected;
    evidence.observed(k) = std::min(observed, kOutlierRatio * expected);
    evidence.expected(k) = expected;
    for (int l = 0; l < 2; ++l) evidence.information(k, l) = (M[k] * U * M[l] * U).trace();
  }
  if (!evidence.information.allFinite()) return;
  const bool enough = evidence.expected.minCoeff() > kLeastExpected;
  // An interval tells the noise by what it was integrated with, and the factors have moved on since: evidence that is taken
  // for that of the present factors drives them past their goal, and back, for as long as the window is.
  const Eigen::Vector2d then = variancesWithin(pre, nominal_);
  const Eigen::Vector2d now(std::pow(factors_.accelerometer, 2), std::pow(factors_.gyroscope, 2));
  evidence.rescale(now.cwiseQuotient(then));
  evidence_.observed += evidence.observed;
  evidence_.expected += evidence.expected;
  evidence_.information += evidence.information;
  if (!enough) return;
  recent_.push_back(shown.cwiseProduct(then));
  if (recent_.size() > kRecentIntervals) recent_.pop_front();
}

double fittedPixelError(const VisualInertialGraph& graph, int* count) {
  std::vector<double> errors;
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    if (!landmark.solved || landmark.observations.size() < 3) continue;
    for (const Observation& observation : landmark.observations)
      if (const FrameState* frame = graph.findFrame(observation.frame))
        errors.push_back(reprojectionError(landmark, observation, *frame, graph.calibration()));
  }
  *count = static_cast<int>(errors.size());
  if (errors.empty()) return 0.0;
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  return errors[errors.size() / 2] / kRayleighMedian;
}

std::optional<double> fittedPixelSigma(const VisualInertialGraph& graph) {
  int count = 0;
  const double fitted = fittedPixelError(graph, &count);
  if (count < kEnoughObservations) return std::nullopt;
  // A landmark of n observations leaves 2n - 3 of 2n degrees of freedom: 0.75 of them at n = 6.
  return std::clamp(fitted / std::sqrt(0.75), kMinPixelSigma, kMaxPixelSigma);
}

std::string solveAdaptingNoise(int max_iterations, double outlier_px, VisualInertialGraph* graph,
                               NoiseAdaptation* noise, const std::atomic<bool>* cancelled) {
  for (int round = 0; round < kNoiseRounds; ++round) {
    if (cancelled && *cancelled) return "cancelled";
    if (!graph->solve(max_iterations, kRoundTolerance).usable) return "the bundle adjustment failed";
    graph->dropOutliers(round == 0 ? outlier_px : std::min(outlier_px, graph->outlierThreshold()));
    if (const std::optional<double> fitted = fittedPixelSigma(*graph)) graph->options().pixel_sigma = *fitted;
    const std::optional<GraphCovariance> covariance = graph->covariance();
    if (!covariance) return "scale and gravity are not determined yet";
    const NoiseFactors before = noise->factors();
    // The same intervals, solved with better noise, replace those of the round before.
    noise->forgetEvidence();
    for (std::size_t i = 1; i < graph->frames().size(); ++i) noise->addInterval(*graph, *covariance, i);
    noise->update();
    for (FrameState& frame : graph->frames())
      if (frame.preintegration) frame.preintegration->repropagate(frame.bias(), noise->noise());
    // The first round does not count: its pixel noise was only assumed.
    if (round > 0 && isClose(before.accelerometer, noise->factors().accelerometer) &&
        isClose(before.gyroscope, noise->factors().gyroscope))
      break;
  }
  return graph->solve(max_iterations, kFinalTolerance).usable ? "" : "the bundle adjustment failed";
}

void NoiseAdaptation::forgetEvidence() {
  evidence_ = Evidence();
}

std::optional<NoiseFactors> NoiseAdaptation::recentFactors() const {
  if (recent_.size() < kRecentIntervals) return std::nullopt;
  const auto median = [this](int k) {
    std::array<double, kRecentIntervals> values;
    std::transform(recent_.begin(), recent_.end(), values.begin(),
                   [k](const Eigen::Vector2d& shown) { return shown(k); });
    std::nth_element(values.begin(), values.begin() + kRecentIntervals / 2, values.end());
    return std::sqrt(values[kRecentIntervals / 2]);
  };
  return NoiseFactors{median(0), median(1)};
}

// Fisher scoring: the ratio of observed to expected squares alone would creep where the images leave most of the
// residual to be absorbed, and would take one sensor's noise for the other's.
Eigen::Vector2d NoiseAdaptation::step() const {
  const double factors[2] = {factors_.accelerometer, factors_.gyroscope};
  // Of the logarithm of the variances, like the evidence; twice its gradient and information, likewise.
  const Eigen::Array2d prior_information = 2.0 * kLogVarianceSigma.square().inverse();
  const Eigen::Array2d from_typical = 2.0 * (Eigen::Array2d(factors[0], factors[1]) / kTypicalFactors).log();
  Eigen::Matrix2d information = evidence_.information;
  information.diagonal().array() += prior_information;
  const Eigen::Vector2d score =
      evidence_.observed - evidence_.expected - (prior_information * from_typical).matrix();
  Eigen::Vector2d step = information.ldlt().solve(score);
  for (int k = 0; k < 2; ++k) {
    // A sensor at its data sheet stays there; what it cannot explain is left to the other.
    if (factors[k] > 1.0 || step(k) > 0.0) continue;
    step(k) = 0.0;
    step(1 - k) = score(1 - k) / information(1 - k, 1 - k);
  }
  return step;
}

void NoiseAdaptation::update() {
  const Eigen::Vector2d wanted = step();
  Eigen::Vector2d ratios;
  double* const factors[2] = {&factors_.accelerometer, &factors_.gyroscope};
  for (int k = 0; k < 2; ++k) {
    // Down by as large a factor as up: a variance has no negative values to step through.
    const double step = kDamping * wanted(k);
    const double ratio =
        std::clamp(step > 0.0 ? 1.0 + step : 1.0 / (1.0 - step), 1.0 / kLargestRatio, kLargestRatio);
    const double before = *factors[k];
    *factors[k] = std::clamp(before * std::sqrt(ratio), 1.0, largest_);
    ratios(k) = std::pow(*factors[k] / before, 2);
  }
  evidence_.rescale(ratios);
  evidence_.observed *= kFade;
  evidence_.expected *= kFade;
  evidence_.information *= kFade;
}

// Of a scalar residual whose innovation has variance T = a + g + n (both sensors, images), the states leave
// (a + g)^2 / T, and its terms are o_k = k z^2 / T^2, e_k = k / T and I_kl = k l / T^2. So I_kl / e_k is the share of l
// in T, and tells T at other variances. Were the terms taken as linear in the step, evidence from where the IMU is
// trusted too much would promise more than it holds, and evidence from where it is trusted too little would never let go.
void NoiseAdaptation::Evidence::rescale(const Eigen::Vector2d& ratios) {
  Eigen::Vector2d gain;
  for (int k = 0; k < 2; ++k) {
    double total = 1.0;
    if (expected(k) > 0.0) total += information.row(k).dot(ratios - Eigen::Vector2d::Ones()) / expected(k);
    total = std::max(total, kSmallestTotal);
    gain(k) = ratios(k) / total;
    observed(k) *= gain(k) / total;
    expected(k) *= gain(k);
  }
  information = gain.asDiagonal() * information * gain.asDiagonal();
}

}  // namespace autocal_vio
