#include "autocal_vio/initializer/known_rotation_structure.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Prior of each point's distance from the middle camera of its track: 1, with these weights in the rounds of
// reweighting. A distance uncertain by 100 % against rays uncertain by a degree is the first.
constexpr double kDistanceWeights[] = {3e-4, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 1e-6};
constexpr double kAngleFloor = 1.0e-3;  // below this residual all observations weigh the same [rad]
// Share of the tracks taken for right. Not the half: a solution in two parts that fits one of them well must not give
// the other up.
constexpr double kRightShare = 0.7;
constexpr double kTrackScale =
    2.0;  // a track that fits worse than these by this factor has a quarter's weight

struct Ray {
  int keyframe;
  Vector3d direction;  // unit, in V
};

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
    residuals_.resize(tracks.size(), 0.0);
    positions_ = VectorXd::Zero(3 * cameras_);
  }

  bool solve() {
    for (const double distance_weight : kDistanceWeights) {
      if (!solvePositions(distance_weight)) return false;
      triangulate(distance_weight);
      reweight();
    }
    return true;
  }

  KnownRotationStructure result() const {
    KnownRotationStructure structure;
    structure.ok = true;
    for (int i = 0; i < cameras_; ++i) structure.p_VC.push_back(positions_.segment<3>(3 * i));
    structure.points = points_;
    structure.residuals = residuals_;
    return structure;
  }

 private:
  static bool isMiddle(const std::vector<Ray>& rays, std::size_t i) { return i == rays.size() / 2; }

  // Weight matrix of X - p of one observation: across the ray, and along it where the distance prior stands.
  Matrix3d weightMatrix(std::size_t track, std::size_t i, double distance_weight) const {
    const std::vector<Ray>& rays = rays_[track];
    const Matrix3d along = rays[i].direction * rays[i].direction.transpose();
    const Matrix3d across = weights_[track][i] * (Matrix3d::Identity() - along);
    return isMiddle(rays, i) ? Matrix3d(across + distance_weight * along) : across;
  }

  // Right-hand side of the distance prior of a track.
  Vector3d priorVector(std::size_t track, double distance_weight) const {
    return distance_weight * rays_[track][rays_[track].size() / 2].direction;
  }

  // Normal equations of the positions once every point is where it is best for them; the first camera stays at zero.
  bool solvePositions(double distance_weight) {
    MatrixXd H = MatrixXd::Zero(3 * cameras_, 3 * cameras_);  // lower triangle
    VectorXd g = VectorXd::Zero(3 * cameras_);
    std::vector<Matrix3d> B, A_inverse_B;
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      const std::vector<Ray>& rays = rays_[track];
      Matrix3d A = Matrix3d::Zero();
      B.clear();
      A_inverse_B.clear();
      for (std::size_t i = 0; i < rays.size(); ++i) {
        B.push_back(weightMatrix(track, i, distance_weight));
        A += B.back();
      }
      const Matrix3d A_inverse = A.inverse();
      const Vector3d prior = priorVector(track, distance_weight);
      for (std::size_t i = 0; i < rays.size(); ++i) {
        A_inverse_B.push_back(A_inverse * B[i]);
        const int row = 3 * rays[i].keyframe;
        g.segment<3>(row) += A_inverse_B[i].transpose() * prior;
        if (isMiddle(rays, i)) g.segment<3>(row) -= prior;
        H.block<3, 3>(row, row) += B[i];
        for (std::size_t j = 0; j <= i; ++j)
          H.block<3, 3>(row, 3 * rays[j].keyframe) -= B[i] * A_inverse_B[j];
      }
    }
    const int unknowns = 3 * (cameras_ - 1);
    const Eigen::LLT<MatrixXd> llt(H.bottomRightCorner(unknowns, unknowns));
    if (llt.info() != Eigen::Success) return false;
    positions_.tail(unknowns) = llt.solve(g.tail(unknowns));
    return positions_.allFinite();
  }

  void triangulate(double distance_weight) {
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      Matrix3d A = Matrix3d::Zero();
      Vector3d b = priorVector(track, distance_weight);
      for (std::size_t i = 0; i < rays_[track].size(); ++i) {
        const Matrix3d B = weightMatrix(track, i, distance_weight);
        A += B;
        b += B * positions_.segment<3>(3 * rays_[track][i].keyframe);
      }
      points_[track] = A.inverse() * b;
    }
  }

  // Distance of each point from its cameras, the mean of all being 1. One distance for the whole track, or a camera
  // could lower its cost by running away.
  std::vector<double> relativeDistances(double* unit) const {
    std::vector<double> distances(rays_.size(), 0.0);
    *unit = 0.0;
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      for (const Ray& ray : rays_[track])
        distances[track] += (points_[track] - positions_.segment<3>(3 * ray.keyframe)).norm();
      distances[track] /= static_cast<double>(rays_[track].size());
      *unit += distances[track] / static_cast<double>(rays_.size());
    }
    for (double& distance : distances) distance = std::clamp(distance / *unit, 0.1, 10.0);
    return distances;
  }

  // The distance between ray and point divided by the point's distance is the angle.
  void reweight() {
    double unit = 0.0;
    const std::vector<double> distances = relativeDistances(&unit);
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      const double d = distances[track];
      double squared = 0.0;
      for (std::size_t i = 0; i < rays_[track].size(); ++i) {
        const Ray& ray = rays_[track][i];
        const Vector3d offset = points_[track] - positions_.segment<3>(3 * ray.keyframe);
        const double angle = ray.direction.cross(offset).norm() / (d * unit);
        squared += angle * angle;
        weights_[track][i] = 1.0 / (d * d * std::max(1.0, angle / kAngleFloor));
      }
      residuals_[track] = std::sqrt(squared / static_cast<double>(rays_[track].size()));
    }
    weighTracks();
  }

  // Geman-McClure over whole tracks.
  void weighTracks() {
    std::vector<double> sorted = residuals_;
    const auto quantile = sorted.begin() + static_cast<std::ptrdiff_t>(kRightShare * (sorted.size() - 1));
    std::nth_element(sorted.begin(), quantile, sorted.end());
    const double scale = std::max(kAngleFloor, kTrackScale * *quantile);
    for (std::size_t track = 0; track < rays_.size(); ++track) {
      const double factor = 1.0 / (1.0 + std::pow(residuals_[track] / scale, 2));
      for (double& weight : weights_[track]) weight *= factor * factor;
    }
  }

  int cameras_;
  std::vector<std::vector<Ray>> rays_;        // per track
  std::vector<std::vector<double>> weights_;  // per track and ray
  VectorXd positions_;                        // 3 per camera, the first zero
  std::vector<Vector3d> points_;              // per track
  std::vector<double> residuals_;             // per track, root mean square angle
};

}  // namespace

KnownRotationStructure solveKnownRotations(const std::vector<StructureTrack>& tracks,
                                           const std::vector<Quaterniond>& R_VC) {
  if (R_VC.size() < 2 || tracks.empty()) return KnownRotationStructure();
  Solver solver(tracks, R_VC);
  return solver.solve() ? solver.result() : KnownRotationStructure();
}

}  // namespace autocal_vio
