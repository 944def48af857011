#include "autocal_vio/initializer/structure_bundle_adjustment.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "autocal_vio/factors/manifolds.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

constexpr double kMinDepthRatio = 0.02;  // depth in the camera over depth in the anchor
constexpr double kBehindPx = 100.0;      // residual of points behind the camera, without derivative
constexpr double kMinInverseDepth = 0.02, kMaxInverseDepth = 50.0;  // at the start, in 1 / median depth
constexpr int kTriangulationIterations = 4;
constexpr double kGaugeWeight = 1e5;  // [px per structure unit]; the cost does not depend on it

Transform toTransform(const double* pose) {
  return Transform(Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5]),
                   Vector3d(pose[0], pose[1], pose[2]));
}

// Blocks: T_VC [p q] (7), [alpha beta rho] (3).
class StructureFactor final : public ceres::SizedCostFunction<2, 7, 3> {
 public:
  StructureFactor(const Transform& T_VA, const TrackObservation& observation)
      : T_VA_(T_VA), observation_(observation) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Transform T_VC = toTransform(parameters[0]);
    const AnchoredLandmark landmark{T_VA_, Eigen::Map<const Vector3d>(parameters[1])};
    Vector2d residual = Vector2d::Constant(kBehindPx);
    Matrix26d J_pose = Matrix26d::Zero();
    Matrix23d J_landmark = Matrix23d::Zero();
    structureResidual(T_VC, landmark, observation_, &residual, &J_pose, &J_landmark);
    residuals[0] = residual.x();
    residuals[1] = residual.y();
    if (!jacobians) return true;
    if (jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> J(jacobians[0]);
      J.leftCols<3>() = J_pose.leftCols<3>();
      J.rightCols<4>() = J_pose.rightCols<3>() * rotationByQuaternion(T_VC.rotation);
    }
    if (jacobians[1]) {
      Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(jacobians[1]);
      J = J_landmark;
    }
    return true;
  }

 private:
  Transform T_VA_;
  TrackObservation observation_;
};

// Holds the scale: the position's component along `direction` stays at `distance`. Block: T_VC [p q] (7).
class ScaleGaugeFactor final : public ceres::SizedCostFunction<1, 7> {
 public:
  ScaleGaugeFactor(const Vector3d& direction, double distance) : direction_(direction), distance_(distance) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    residuals[0] = kGaugeWeight * (direction_.dot(Eigen::Map<const Vector3d>(parameters[0])) - distance_);
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 1, 7>> J(jacobians[0]);
      J << kGaugeWeight * direction_.transpose(), 0.0, 0.0, 0.0, 0.0;
    }
    return true;
  }

 private:
  Vector3d direction_;
  double distance_;
};

// Offset of the keyframe farthest from the first, and its number.
Vector3d farthestOffset(const StructureProblem& problem, int* keyframe) {
  const Vector3d origin = problem.pose(0).translation;
  Vector3d farthest = Vector3d::Zero();
  *keyframe = 0;
  for (std::size_t k = 1; k < problem.poses.size(); ++k) {
    const Vector3d offset = problem.pose(static_cast<int>(k)).translation - origin;
    if (offset.squaredNorm() <= farthest.squaredNorm()) continue;
    farthest = offset;
    *keyframe = static_cast<int>(k);
  }
  return farthest;
}

void buildProblem(double robust_px, StructureProblem* structure, ceres::Problem* problem,
                  ceres::ParameterBlockOrdering* ordering) {
  for (std::array<double, 7>& pose : structure->poses) {
    problem->AddParameterBlock(pose.data(), 7, new PoseManifold());
    ordering->AddElementToGroup(pose.data(), 1);
  }
  problem->SetParameterBlockConstant(structure->poses.front().data());
  // One loss object for all residuals; the problem owns it.
  auto* loss = new ceres::HuberLoss(robust_px);
  for (std::size_t t = 0; t < structure->tracks.size(); ++t) {
    AnchoredLandmark& landmark = structure->landmarks[t];
    double* block = landmark.alpha_beta_rho.data();
    problem->AddParameterBlock(block, 3);
    ordering->AddElementToGroup(block, 0);
    for (const TrackObservation& observation : structure->tracks[t].observations)
      problem->AddResidualBlock(new StructureFactor(landmark.T_VA, observation), loss,
                                structure->poses[observation.keyframe].data(), block);
  }
  int farthest = 0;
  const Vector3d offset = farthestOffset(*structure, &farthest);
  if (farthest == 0) return;
  const Vector3d direction = offset.normalized();
  const double distance = direction.dot(structure->pose(farthest).translation);
  problem->AddResidualBlock(new ScaleGaugeFactor(direction, distance), nullptr,
                            structure->poses[farthest].data());
}

// Adds one track's information to the poses' (landmark eliminated). False when the landmark is not determined.
bool addTrackInformation(const StructureProblem& problem, std::size_t t, MatrixXd* H) {
  const std::vector<TrackObservation>& observations = problem.tracks[t].observations;
  Matrix3d H_landmark = Matrix3d::Zero();
  std::vector<Eigen::Matrix<double, 6, 3>> cross(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    Vector2d residual;
    Matrix26d J_pose;
    Matrix23d J_landmark;
    const int k = observations[i].keyframe;
    if (!structureResidual(problem.pose(k), problem.landmarks[t], observations[i], &residual, &J_pose,
                           &J_landmark))
      return false;
    H_landmark += J_landmark.transpose() * J_landmark;
    cross[i] = J_pose.transpose() * J_landmark;
    H->block<6, 6>(6 * k, 6 * k) += J_pose.transpose() * J_pose;
  }
  // Depth may be open where a track shows no parallax; it then says nothing about the depth, and no more.
  H_landmark.diagonal().array() += 1e-9 * H_landmark.trace();
  const Eigen::LDLT<Matrix3d> ldlt(H_landmark);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Eigen::Matrix<double, 3, 6> solved = ldlt.solve(cross[i].transpose());
    for (std::size_t j = 0; j < observations.size(); ++j)
      H->block<6, 6>(6 * observations[j].keyframe, 6 * observations[i].keyframe) -= cross[j] * solved;
  }
  return true;
}

// Inverse depth along a ray of the anchor by linear least squares: each observation says that
// bearing x (R_CA d + rho p_CA) = 0.
double linearInverseDepth(const StructureProblem& problem, const StructureTrack& track, const Transform& T_VA,
                          const Vector2d& anchor) {
  double numerator = 0.0, denominator = 0.0;
  for (const TrackObservation& observation : track.observations) {
    const Transform T_CA = problem.pose(observation.keyframe).inverse() * T_VA;
    const Vector3d bearing = observation.normalized.homogeneous().normalized();
    const Vector3d by_rho = bearing.cross(T_CA.translation);
    numerator -= by_rho.dot(bearing.cross(T_CA.rotation * anchor.homogeneous()));
    denominator += by_rho.squaredNorm();
  }
  return denominator > 1e-12 ? numerator / denominator : 1.0;
}

}  // namespace

Transform StructureProblem::pose(int keyframe) const {
  return toTransform(poses[keyframe].data());
}

bool structureResidual(const Transform& T_VC, const AnchoredLandmark& landmark,
                       const TrackObservation& observation, Vector2d* residual, Matrix26d* J_pose,
                       Matrix23d* J_landmark) {
  const Matrix3d R_CV = T_VC.rotation.conjugate().toRotationMatrix();
  const double rho = landmark.alpha_beta_rho.z();
  const Vector3d offset_V = landmark.T_VA.translation - T_VC.translation;
  const Matrix3d R_CA = R_CV * landmark.T_VA.rotationMatrix();
  // The point in the camera frame times rho; exists for points at infinity.
  const Vector3d h = rho * (R_CV * offset_V) +
                     R_CA * Vector3d(landmark.alpha_beta_rho.x(), landmark.alpha_beta_rho.y(), 1.0);
  if (!(h.z() > kMinDepthRatio)) return false;
  *residual = observation.pixel_jacobian * (observation.normalized - h.hnormalized());
  Matrix23d J_h;
  J_h << 1.0, 0.0, -h.x() / h.z(), 0.0, 1.0, -h.y() / h.z();
  J_h = (observation.pixel_jacobian * J_h / -h.z()).eval();
  if (J_pose) *J_pose << -rho * J_h * R_CV, J_h * skew(h);
  if (J_landmark) *J_landmark << J_h * R_CA.leftCols<2>(), J_h * (R_CV * offset_V);
  return true;
}

double trackRmsPx(const StructureProblem& problem, std::size_t track) {
  double squared = 0.0;
  for (const TrackObservation& observation : problem.tracks[track].observations) {
    Vector2d residual;
    if (!structureResidual(problem.pose(observation.keyframe), problem.landmarks[track], observation,
                           &residual))
      return std::numeric_limits<double>::infinity();
    squared += residual.squaredNorm();
  }
  return std::sqrt(squared / (2.0 * static_cast<double>(problem.tracks[track].observations.size())));
}

std::optional<AnchoredLandmark> triangulateTrack(const StructureProblem& problem,
                                                 const StructureTrack& track) {
  const TrackObservation& middle = track.observations[track.observations.size() / 2];
  AnchoredLandmark landmark;
  landmark.T_VA = problem.pose(middle.keyframe);
  const double rho = linearInverseDepth(problem, track, landmark.T_VA, middle.normalized);
  landmark.alpha_beta_rho << middle.normalized, std::clamp(rho, kMinInverseDepth, kMaxInverseDepth);
  for (int iteration = 0; iteration < kTriangulationIterations; ++iteration) {
    Matrix3d H = Matrix3d::Zero();
    Vector3d g = Vector3d::Zero();
    for (const TrackObservation& observation : track.observations) {
      Vector2d residual;
      Matrix23d J;
      if (!structureResidual(problem.pose(observation.keyframe), landmark, observation, &residual, nullptr,
                             &J))
        return std::nullopt;
      H += J.transpose() * J;
      g += J.transpose() * residual;
    }
    H.diagonal() *= 1.0 + 1e-6;  // a track without parallax says nothing about its depth
    const Vector3d step = H.ldlt().solve(g);
    if (!step.allFinite()) return std::nullopt;
    landmark.alpha_beta_rho -= step;
  }
  return landmark;
}

int adjustStructure(double robust_px, int max_iterations, StructureProblem* structure) {
  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  buildProblem(robust_px, structure, &problem, ordering.get());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.max_num_iterations = max_iterations;
  options.function_tolerance = 1e-5;
  options.parameter_tolerance = 1e-12;
  options.gradient_tolerance = 1e-12;
  options.initial_trust_region_radius = 1e4;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return -1;
  return static_cast<int>(summary.iterations.size()) - 1;
}

MatrixXd structurePoseCovariance(const StructureProblem& problem, double sigma_px) {
  const int n = static_cast<int>(problem.poses.size());
  MatrixXd H = MatrixXd::Zero(6 * n, 6 * n);
  for (std::size_t t = 0; t < problem.tracks.size(); ++t)
    if (!addTrackInformation(problem, t, &H)) return MatrixXd();
  int farthest = 0;
  const Vector3d offset = farthestOffset(problem, &farthest);
  if (farthest == 0) return MatrixXd();
  const Vector3d direction = offset.normalized();
  H.block<3, 3>(6 * farthest, 6 * farthest) +=
      kGaugeWeight * kGaugeWeight * direction * direction.transpose();
  const Eigen::LDLT<MatrixXd> ldlt(H.bottomRightCorner(6 * (n - 1), 6 * (n - 1)));
  if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff() > 0.0)) return MatrixXd();
  MatrixXd covariance = MatrixXd::Zero(6 * n, 6 * n);
  covariance.bottomRightCorner(6 * (n - 1), 6 * (n - 1)) =
      sigma_px * sigma_px * ldlt.solve(MatrixXd::Identity(6 * (n - 1), 6 * (n - 1)));
  return 0.5 * (covariance + covariance.transpose());
}

}  // namespace autocal_vio
