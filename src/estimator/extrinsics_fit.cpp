#include "autocal_vio/estimator/extrinsics_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix26d = Eigen::Matrix<double, 2, 6>;

constexpr int kIterations = 12;
constexpr int kFewestPoints = 6;
constexpr double kLargestLengthening = 2.0;  // of the baseline: the depth of a landmark is known no further
constexpr double kLeastBaseline = 0.001;     // [m]
constexpr double kPriorRotation = 0.1;       // [rad] a mount does not move further than a few of this
constexpr double kPriorTranslation = 0.05;   // [m]
constexpr double kRobustScale = 2.0;         // of the median error: points further out fade
constexpr double kLeastScaleSigmas = 3.0;    // and at least this many sigmas of a pixel
constexpr double kSmallestDepth = 0.02;      // homogeneous, as for all reprojections here

// A landmark as the body has it at the newest image: its direction times 1 - rho z, and its inverse depth.
struct SeenPoint {
  Eigen::Vector3d h_B = Eigen::Vector3d::Zero();
  double rho = 0.0;
  Feature feature;
};

// How far the newest image is from where the landmark was anchored, across the line of sight, over how far the others
// that have seen it are: what is wrong with its depth shows in the newest image this many times as much.
double lengthening(const Landmark& landmark, const VisualInertialGraph& graph) {
  const Transform T_BC = graph.calibration().T_BC();
  const Eigen::Vector3d line =
      landmark.T_WA.rotation *
      Eigen::Vector3d(landmark.parameters[0], landmark.parameters[1], 1.0).normalized();
  double longest = kLeastBaseline;
  for (const Observation& observation : landmark.observations) {
    const FrameState* frame = graph.findFrame(observation.frame);
    if (!frame) continue;
    const double across = line.cross(frame->T_WB() * T_BC.translation - landmark.T_WA.translation).norm();
    if (frame == &graph.frames().back()) return across / longest;
    longest = std::max(longest, across);
  }
  return 0.0;
}

std::vector<SeenPoint> seenPoints(const VisualInertialGraph& graph) {
  std::vector<SeenPoint> points;
  const FrameState& newest = graph.frames().back();
  const Eigen::Quaterniond R_BW = newest.rotation().conjugate();
  for (const auto& [id, landmark] : graph.landmarkMap().landmarks()) {
    if (!landmark.solved || !landmark.initialized || landmark.observations.back().frame != newest.id)
      continue;
    if (lengthening(landmark, graph) > kLargestLengthening) continue;
    const Eigen::Vector3d direction(landmark.parameters[0], landmark.parameters[1], 1.0);
    const double rho = landmark.parameters[2];
    SeenPoint point;
    point.h_B =
        R_BW * (landmark.T_WA.rotation * direction + rho * (landmark.T_WA.translation - newest.position()));
    point.rho = rho;
    point.feature = landmark.observations.back().feature;
    points.push_back(point);
  }
  return points;
}

// Measured minus predicted [px], and its Jacobian by [p_BC, theta] where wanted; false when behind the camera.
bool evaluate(const SeenPoint& point, const Transform& T_BC, Eigen::Vector2d* error, Matrix26d* jacobian) {
  const Eigen::Matrix3d R_CB = T_BC.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d h = R_CB * (point.h_B - point.rho * T_BC.translation);
  if (!(h.z() > kSmallestDepth)) return false;
  *error = point.feature.pixel_jacobian * (point.feature.normalized - h.head<2>() / h.z());
  if (!jacobian) return true;
  Eigen::Matrix<double, 2, 3> by_h;
  by_h << 1.0 / h.z(), 0.0, -h.x() / (h.z() * h.z()), 0.0, 1.0 / h.z(), -h.y() / (h.z() * h.z());
  Eigen::Matrix<double, 3, 6> h_by_state;
  h_by_state << -point.rho * R_CB, skew(h);
  *jacobian = -point.feature.pixel_jacobian * by_h * h_by_state;
  return true;
}

std::vector<double> errorsOf(const std::vector<SeenPoint>& points, const Transform& T_BC) {
  std::vector<double> errors;
  Eigen::Vector2d error;
  for (const SeenPoint& point : points)
    errors.push_back(evaluate(point, T_BC, &error, nullptr) ? error.norm()
                                                            : std::numeric_limits<double>::infinity());
  return errors;
}

double medianOf(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// One reweighted Gauss-Newton step [p_BC, theta]; points further out than `scale` [px] count little.
Vector6d stepOf(const std::vector<SeenPoint>& points, const Transform& T_BC, const Transform& prior,
                double scale, double pixel_sigma) {
  Vector6d information, offset;
  information << Eigen::Vector3d::Constant(std::pow(kPriorTranslation, -2)),
      Eigen::Vector3d::Constant(std::pow(kPriorRotation, -2));
  offset << T_BC.translation - prior.translation, logSo3(prior.rotation.conjugate() * T_BC.rotation);
  Matrix6d H = information.asDiagonal();
  Vector6d g = information.cwiseProduct(offset);
  Eigen::Vector2d error;
  Matrix26d jacobian;
  for (const SeenPoint& point : points) {
    if (!evaluate(point, T_BC, &error, &jacobian)) continue;
    const double weight =
        std::pow(1.0 + error.squaredNorm() / (scale * scale), -2) / (pixel_sigma * pixel_sigma);
    H += weight * jacobian.transpose() * jacobian;
    g += weight * jacobian.transpose() * error;
  }
  return -H.ldlt().solve(g);
}

}  // namespace

Vector6d ExtrinsicsFit::stepFrom(const Transform& before) const {
  Vector6d step;
  step << before.rotation.conjugate() * (T_BC.translation - before.translation),
      logSo3(before.rotation.conjugate() * T_BC.rotation);
  return step;
}

ExtrinsicsFit fitExtrinsicsToNewest(const VisualInertialGraph& graph, double threshold_px) {
  const std::vector<SeenPoint> points = seenPoints(graph);
  const Transform before = graph.calibration().T_BC();
  ExtrinsicsFit fit;
  fit.T_BC = before;
  fit.count = static_cast<int>(points.size());
  if (fit.count < kFewestPoints) return fit;
  const double pixel_sigma = graph.optionsView().pixel_sigma;
  fit.error_before = fit.error_after = medianOf(errorsOf(points, before));
  for (int i = 0; i < kIterations; ++i) {
    const double scale = std::max(kLeastScaleSigmas * pixel_sigma, kRobustScale * fit.error_after);
    const Vector6d step = stepOf(points, fit.T_BC, before, scale, pixel_sigma);
    if (!step.allFinite()) break;
    fit.T_BC =
        Transform(fit.T_BC.rotation * expSo3(step.tail<3>().eval()), fit.T_BC.translation + step.head<3>());
    fit.error_after = medianOf(errorsOf(points, fit.T_BC));
    if (step.head<3>().norm() < 1e-5 && step.tail<3>().norm() < 1e-5) break;
  }
  int fitting = 0;
  for (const double error : errorsOf(points, fit.T_BC)) fitting += error < threshold_px;
  fit.share_fitting = static_cast<double>(fitting) / fit.count;
  return fit;
}

}  // namespace autocal_vio
