#include "autocal_vio/initializer/known_rotation_structure.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kRounds = 8;                // of reweighting
constexpr int kPowerIterations = 12;      // of the inverse iteration, each round starts from the last
constexpr double kAngleFloor = 1.0e-3;    // below this residual all observations weigh the same [rad]
constexpr double kRegularization = 1e-9;  // holds points whose rays are parallel

struct Ray {
  int keyframe;
  Vector3d direction;  // unit, in V
};

// (I - r r^T), the projector away from the ray.
Matrix3d projector(const Ray& ray) {
  return Matrix3d::Identity() - ray.direction * ray.direction.transpose();
}

class Solver {
 public:
  Solver(const std::vector<StructureTrack>& tracks, const std::vector<Quaterniond>& R_VC)
      : cameras_(static_cast<int>(R_VC.size())) {
    for (const StructureTrack& track : tracks) {
      std::vector<Ray> rays;
      for (const TrackObservation& o : track.observations)
        rays.push_back(Ray{o.keyframe, (R_VC[o.keyframe] * o.normalized.homogeneous()).normalized()});
      rays_.push_back(rays);
      weights_.emplace_back(rays.size(), 1.0);
    }
    points_.resize(tracks.size(), Vector3d::Zero());
    // Any start that is not orthogonal to the solution will do; this one is reproducible.
    positions_ = VectorXd::Zero(3 * cameras_);
    for (int i = 3; i < 3 * cameras_; ++i) positions_(i) = 1.0 + 0.37 * std::sin(1.7 * i);
  }

  bool solve() {
    for (int round = 0; round < kRounds; ++round) {
      if (!smallestEigenvector(reducedMatrix())) return false;
      triangulate();
      reweight();
    }
    chooseSign();
    return true;
  }

  KnownRotationStructure result() const {
    KnownRotationStructure structure;
    structure.ok = true;
    for (int i = 0; i < cameras_; ++i) structure.p_VC.push_back(positions_.segment<3>(3 * i));
    structure.points = points_;
    return structure;
  }

 private:
  // Sum of the weighted projectors of a track; its inverse gives the point.
  Eigen::LDLT<Matrix3d> pointMatrix(std::size_t track) const {
    Matrix3d A = Matrix3d::Zero();
    for (std::size_t i = 0; i < rays_[track].size(); ++i)
      A += weights_[track][i] * projector(rays_[track][i]);
    return (A + kRegularization * A.trace() * Matrix3d::Identity()).ldlt();
  }

  // Quadratic form of the positions once every point is where it is best, without the first camera.
  MatrixXd reducedMatrix() const {
    MatrixXd Q = MatrixXd::Zero(3 * cameras_, 3 * cameras_);
    std::vector<Matrix3d> M, A_inverse_M;
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      const std::vector<Ray>& rays = rays_[track];
      const Eigen::LDLT<Matrix3d> A = pointMatrix(track);
      M.clear();
      A_inverse_M.clear();
      for (std::size_t i = 0; i < rays.size(); ++i) {
        M.push_back(weights_[track][i] * projector(rays[i]));
        A_inverse_M.push_back(A.solve(M.back()));
      }
      for (std::size_t i = 0; i < rays.size(); ++i) {
        const int row = 3 * rays[i].keyframe;
        Q.block<3, 3>(row, row) += M[i];
        for (std::size_t j = 0; j <= i; ++j)
          Q.block<3, 3>(row, 3 * rays[j].keyframe) -= M[i] * A_inverse_M[j];
      }
    }
    return Q.bottomRightCorner(3 * (cameras_ - 1), 3 * (cameras_ - 1));  // lower triangle
  }

  bool smallestEigenvector(MatrixXd Q) {
    Q.diagonal().array() += 1e-12 * Q.trace() / static_cast<double>(Q.rows());
    const Eigen::LLT<MatrixXd> llt(Q);  // reads the lower triangle
    if (llt.info() != Eigen::Success) return false;
    VectorXd x = positions_.tail(Q.rows());
    for (int i = 0; i < kPowerIterations; ++i) {
      x = llt.solve(x);
      const double norm = x.norm();
      if (!(norm > 0.0) || !std::isfinite(norm)) return false;
      x /= norm;
    }
    positions_.tail(Q.rows()) = x;
    return true;
  }

  void triangulate() {
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      Vector3d b = Vector3d::Zero();
      for (std::size_t i = 0; i < rays_[track].size(); ++i) {
        const Ray& ray = rays_[track][i];
        b += weights_[track][i] * (projector(ray) * positions_.segment<3>(3 * ray.keyframe));
      }
      points_[track] = pointMatrix(track).solve(b);
    }
  }

  // The distance between ray and point divided by the point's distance is the angle; one distance for the whole track,
  // or a camera could lower its cost by running away.
  void reweight() {
    double mean_distance = 0.0;
    std::vector<double> distance(rays_.size(), 0.0);
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      for (const Ray& ray : rays_[track])
        distance[track] += (points_[track] - positions_.segment<3>(3 * ray.keyframe)).norm();
      distance[track] /= static_cast<double>(rays_[track].size());
      mean_distance += distance[track] / static_cast<double>(rays_.size());
    }
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      const double d = std::clamp(distance[track], 0.1 * mean_distance, 10.0 * mean_distance) / mean_distance;
      for (std::size_t i = 0; i < rays_[track].size(); ++i) {
        const Ray& ray = rays_[track][i];
        const Vector3d offset = points_[track] - positions_.segment<3>(3 * ray.keyframe);
        const double angle = ray.direction.cross(offset).norm() / (d * mean_distance);
        weights_[track][i] = 1.0 / (d * d * std::max(1.0, angle / kAngleFloor));
      }
    }
  }

  void chooseSign() {
    int front = 0, behind = 0;
    for (std::size_t track = 0; track < rays_.size(); ++track)
      for (const Ray& ray : rays_[track])
        ++(ray.direction.dot(points_[track] - positions_.segment<3>(3 * ray.keyframe)) > 0.0 ? front
                                                                                             : behind);
    if (front >= behind) return;
    positions_ = -positions_;
    for (Vector3d& point : points_) point = -point;
  }

  int cameras_;
  std::vector<std::vector<Ray>> rays_;        // per track
  std::vector<std::vector<double>> weights_;  // per track and ray
  VectorXd positions_;                        // 3 per camera, the first zero
  std::vector<Vector3d> points_;              // per track
};

}  // namespace

KnownRotationStructure solveKnownRotations(const std::vector<StructureTrack>& tracks,
                                           const std::vector<Quaterniond>& R_VC) {
  if (R_VC.size() < 2 || tracks.empty()) return KnownRotationStructure();
  Solver solver(tracks, R_VC);
  return solver.solve() ? solver.result() : KnownRotationStructure();
}

}  // namespace autocal_vio
