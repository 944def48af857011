#include "autocal_vio/initializer/structure_tracks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>

#include "autocal_vio/frontend/common_tracks.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kMinCommonTracks = 12;
constexpr double kMinCommonShare = 0.4;
constexpr double kRotationLossPx = 2.0;

struct Pair {
  const Feature* a;
  const Feature* b;
};

std::vector<Pair> commonTracks(const FeatureFrame& a, const FeatureFrame& b) {
  std::vector<Pair> pairs;
  forEachCommonTrack(a.features, b.features, [&pairs](const Feature& in_a, const Feature& in_b) {
    pairs.push_back(Pair{&in_a, &in_b});
  });
  return pairs;
}

Vector3d ray(const Feature& feature) {
  return feature.normalized.homogeneous();
}

// Residual [px] in image b of a pure rotation R_ba; false when the ray leaves the image plane's front.
bool rotationResidual(const Pair& pair, const Quaterniond& R_ba, Vector2d* residual,
                      Eigen::Matrix<double, 2, 3>* J) {
  const Vector3d h = R_ba * ray(*pair.a);
  if (!(h.z() > 0.05)) return false;
  Eigen::Matrix<double, 2, 3> J_h;
  J_h << 1.0, 0.0, -h.x() / h.z(), 0.0, 1.0, -h.y() / h.z();
  *residual = pair.b->pixel_jacobian * (h.hnormalized() - pair.b->normalized);
  *J = pair.b->pixel_jacobian * J_h * (-R_ba.toRotationMatrix() * skew(ray(*pair.a))) / h.z();
  return true;
}

// Median residual of the best rotation between two images, by robust Gauss-Newton from a guess.
double rotationFitPx(const std::vector<Pair>& pairs, Quaterniond R_ba) {
  std::vector<double> norms;
  for (int iteration = 0;; ++iteration) {
    Matrix3d H = Matrix3d::Zero();
    Vector3d g = Vector3d::Zero();
    norms.clear();
    for (const Pair& pair : pairs) {
      Vector2d r;
      Eigen::Matrix<double, 2, 3> J;
      if (!rotationResidual(pair, R_ba, &r, &J)) continue;
      norms.push_back(r.norm());
      const double weight = 1.0 / (1.0 + r.squaredNorm() / (kRotationLossPx * kRotationLossPx));
      H += weight * J.transpose() * J;
      g += weight * J.transpose() * r;
    }
    if (norms.size() < 4) return 0.0;
    if (iteration == 10) break;
    const Vector3d step = -(H + 1e-9 * H.trace() * Matrix3d::Identity()).ldlt().solve(g);
    R_ba = (R_ba * expSo3(step)).normalized();
    if (step.norm() < 1e-6) break;
  }
  std::nth_element(norms.begin(), norms.begin() + norms.size() / 2, norms.end());
  return norms[norms.size() / 2];
}

}  // namespace

std::vector<StructureTrack> selectTracks(const std::vector<FeatureFrame>& keyframes, int min_length,
                                         int max_per_keyframe) {
  std::map<std::int64_t, StructureTrack> all;
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    for (const Feature& feature : keyframes[k].features) {
      StructureTrack& track = all[feature.track_id];
      track.id = feature.track_id;
      track.observations.push_back(
          TrackObservation{static_cast<int>(k), feature.normalized, feature.pixel_jacobian});
    }
  }
  std::vector<StructureTrack> candidates;
  for (auto& entry : all)
    if (static_cast<int>(entry.second.observations.size()) >= min_length)
      candidates.push_back(std::move(entry.second));
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const StructureTrack& a, const StructureTrack& b) {
                     return a.observations.size() > b.observations.size();
                   });
  std::vector<int> count(keyframes.size(), 0);
  std::vector<StructureTrack> selected;
  for (StructureTrack& track : candidates) {
    const bool wanted =
        std::any_of(track.observations.begin(), track.observations.end(),
                    [&](const TrackObservation& o) { return count[o.keyframe] < max_per_keyframe; });
    if (!wanted) continue;
    for (const TrackObservation& observation : track.observations) ++count[observation.keyframe];
    selected.push_back(std::move(track));
  }
  std::sort(selected.begin(), selected.end(),
            [](const StructureTrack& a, const StructureTrack& b) { return a.id < b.id; });
  return selected;
}

std::optional<double> translationalParallaxPx(const std::vector<FeatureFrame>& keyframes,
                                              const std::vector<Quaterniond>& R_VC) {
  std::optional<double> largest;
  for (std::size_t i = 0; i + 1 < keyframes.size(); ++i) {
    for (std::size_t j = keyframes.size() - 1; j > i; --j) {
      const std::vector<Pair> pairs = commonTracks(keyframes[i], keyframes[j]);
      const double needed = std::max<double>(
          kMinCommonTracks, kMinCommonShare * static_cast<double>(keyframes[i].features.size()));
      if (static_cast<double>(pairs.size()) < needed) continue;
      largest = std::max(largest.value_or(0.0), rotationFitPx(pairs, R_VC[j].conjugate() * R_VC[i]));
      break;
    }
  }
  return largest;
}

}  // namespace autocal_vio
