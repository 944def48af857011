#include "autocal_vio/initializer/structure_from_motion.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "autocal_vio/initializer/known_rotation_structure.h"
#include "autocal_vio/initializer/structure_bundle_adjustment.h"
#include "autocal_vio/initializer/structure_tracks.h"

namespace autocal_vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kOutlierRatio = 4.0;  // a track that fits worse than the median by this factor is wrong
constexpr double kLeastOutlierAngle =
    2e-3;                            // [rad] a track that fits the linear solution better is no outlier of it
constexpr double kLeastShare = 0.6;  // of a keyframe's tracks that fit
constexpr double kCoarseOutlierPx = 100.0;  // after the first round, with poses that may still be far off

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string checkInput(const std::vector<FeatureFrame>& keyframes, const std::vector<Quaterniond>& R_VC) {
  std::ostringstream problem;
  if (keyframes.size() < 3) problem << "structure needs at least 3 keyframes, has " << keyframes.size();
  if (keyframes.size() != R_VC.size())
    problem << keyframes.size() << " keyframes but " << R_VC.size() << " rotations";
  for (std::size_t k = 0; k < R_VC.size(); ++k)
    if (!R_VC[k].coeffs().allFinite() || !(R_VC[k].norm() > 0.5))
      problem << "the rotation of keyframe " << k << " is not finite";
  for (std::size_t k = 0; k < keyframes.size(); ++k)
    for (const Feature& feature : keyframes[k].features)
      if (!feature.normalized.allFinite() || !feature.pixel_jacobian.allFinite())
        problem << "track " << feature.track_id << " is not finite in keyframe " << k;
  return problem.str();
}

std::vector<int> observationCounts(const std::vector<StructureTrack>& tracks, std::size_t keyframes) {
  std::vector<int> count(keyframes, 0);
  for (const StructureTrack& track : tracks)
    for (const TrackObservation& observation : track.observations) ++count[observation.keyframe];
  return count;
}

std::string checkTracks(const std::vector<StructureTrack>& tracks, std::size_t keyframes,
                        const StructureOptions& options) {
  std::ostringstream problem;
  const std::vector<int> counts = observationCounts(tracks, keyframes);
  const auto fewest = std::min_element(counts.begin(), counts.end());
  if (static_cast<int>(tracks.size()) < options.min_landmarks) {
    problem << "only " << tracks.size() << " tracks last over " << options.min_track_length
            << " keyframes and fit";
  } else if (*fewest < options.min_landmarks_per_keyframe) {
    problem << "keyframe " << fewest - counts.begin() << " sees only " << *fewest << " landmarks";
  }
  return problem.str();
}

// A structure in parts that do not fit together fits each part well and drops the tracks between them: some keyframe
// then keeps few of its tracks.
std::string checkShares(const std::vector<StructureTrack>& tracks, const std::vector<StructureTrack>& kept,
                        std::size_t keyframes) {
  const std::vector<int> before = observationCounts(tracks, keyframes),
                         after = observationCounts(kept, keyframes);
  std::ostringstream problem;
  for (std::size_t k = 0; k < keyframes && problem.str().empty(); ++k)
    if (after[k] < kLeastShare * before[k])
      problem << "only " << after[k] << " of " << before[k] << " tracks in keyframe " << k
              << " fit the structure";
  return problem.str();
}

// The linear solution as a start for the bundle adjustment, scaled to median depth 1, with the tracks that fit it.
StructureProblem startProblem(const std::vector<StructureTrack>& tracks, const std::vector<Quaterniond>& R_VC,
                              const KnownRotationStructure& linear) {
  std::vector<double> depths;
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    const int k = tracks[t].observations.front().keyframe;
    depths.push_back(std::abs((R_VC[k].conjugate() * (linear.points[t] - linear.p_VC[k])).z()));
  }
  const double unit = median(depths);
  const double limit = std::max(kLeastOutlierAngle, kOutlierRatio * median(linear.residuals));
  StructureProblem problem;
  for (std::size_t k = 0; k < R_VC.size(); ++k) {
    const Vector3d p = linear.p_VC[k] / unit;
    problem.poses.push_back({p.x(), p.y(), p.z(), R_VC[k].x(), R_VC[k].y(), R_VC[k].z(), R_VC[k].w()});
  }
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    if (linear.residuals[t] > limit) continue;
    const std::optional<AnchoredLandmark> landmark = triangulateTrack(problem, tracks[t]);
    if (!landmark) continue;
    problem.tracks.push_back(tracks[t]);
    problem.landmarks.push_back(*landmark);
  }
  return problem;
}

std::vector<double> allTrackRms(const StructureProblem& problem) {
  std::vector<double> rms;
  for (std::size_t t = 0; t < problem.tracks.size(); ++t) rms.push_back(trackRmsPx(problem, t));
  return rms;
}

// Takes all tracks that fit the present poses, whether they were in the problem before or not. The limit follows the
// median track, within `least_px` and `most_px`.
void chooseTracks(const std::vector<StructureTrack>& tracks, double least_px, double most_px,
                  StructureProblem* problem) {
  StructureProblem all;
  all.poses = problem->poses;
  for (const StructureTrack& track : tracks) {
    const std::optional<AnchoredLandmark> landmark = triangulateTrack(all, track);
    if (!landmark) continue;
    all.tracks.push_back(track);
    all.landmarks.push_back(*landmark);
  }
  const std::vector<double> rms = allTrackRms(all);
  const double limit = std::min(most_px, std::max(least_px, kOutlierRatio * median(rms)));
  problem->tracks.clear();
  problem->landmarks.clear();
  for (std::size_t t = 0; t < all.tracks.size(); ++t) {
    if (!(rms[t] <= limit) || !(all.landmarks[t].alpha_beta_rho.z() > 0.0)) continue;
    problem->tracks.push_back(all.tracks[t]);
    problem->landmarks.push_back(all.landmarks[t]);
  }
}

double totalRms(const StructureProblem& problem) {
  double squared = 0.0, count = 0.0;
  for (std::size_t t = 0; t < problem.tracks.size(); ++t) {
    const double n = static_cast<double>(problem.tracks[t].observations.size());
    squared += n * std::pow(trackRmsPx(problem, t), 2);
    count += n;
  }
  return count > 0.0 ? std::sqrt(squared / count) : 0.0;
}

// Rounds of bundle adjustment: with the tracks that fit the linear solution, then twice with those that fit the round
// before, so that a track that was misjudged comes back.
std::string adjust(const std::vector<StructureTrack>& tracks, const StructureOptions& options,
                   StructureProblem* problem, StructureResult* result) {
  const double start_error = median(allTrackRms(*problem));
  const double wide_px = std::isfinite(start_error) ? std::max(options.robust_px, 0.5 * start_error) : 10.0;
  for (const double robust_px : {wide_px, options.robust_px, options.robust_px}) {
    const int iterations = adjustStructure(robust_px, options.max_iterations, problem);
    if (iterations < 0) return "the bundle adjustment failed";
    const bool coarse = result->iterations == 0;
    result->iterations += iterations;
    chooseTracks(tracks, coarse ? options.outlier_px : options.robust_px,
                 coarse ? kCoarseOutlierPx : options.outlier_px, problem);
    const std::string failure = checkTracks(problem->tracks, problem->poses.size(), options);
    if (!failure.empty()) return failure;
  }
  const std::string failure = checkShares(tracks, problem->tracks, problem->poses.size());
  if (!failure.empty()) return failure;
  result->rms_px = totalRms(*problem);
  if (result->rms_px <= options.max_rms_px) return std::string();
  std::ostringstream reason;
  reason << "the structure does not fit the tracks: " << result->rms_px << " px";
  return reason.str();
}

// Standard deviation of the pixel noise that left these errors: the poses and landmarks took some of it up.
double pixelSigma(const StructureProblem& problem, double rms_px) {
  double observations = 0.0;
  for (const StructureTrack& track : problem.tracks)
    observations += static_cast<double>(track.observations.size());
  const double unknowns = 3.0 * static_cast<double>(problem.tracks.size()) +
                          6.0 * static_cast<double>(problem.poses.size()) - 7.0;
  return rms_px * std::sqrt(2.0 * observations / std::max(1.0, 2.0 * observations - unknowns));
}

// Median depth of the landmarks that the first keyframe sees; of all in their first keyframes where those are few.
double medianDepth(const StructureProblem& problem) {
  constexpr std::size_t kEnough = 8;
  std::vector<double> first, all;
  for (std::size_t t = 0; t < problem.tracks.size(); ++t) {
    const int k = problem.tracks[t].observations.front().keyframe;
    all.push_back((problem.pose(k).inverse() * problem.landmarks[t].point()).z());
    if (k == 0) first.push_back(all.back());
  }
  return median(first.size() >= kEnough ? first : all);
}

void fillResult(const StructureProblem& problem, StructureResult* result) {
  const double unit = medianDepth(problem);
  if (!(unit > 0.0) || !std::isfinite(unit)) {
    result->failure = "the structure has no depth";
    return;
  }
  const int n = static_cast<int>(problem.poses.size());
  const Transform T_0V = problem.pose(0).inverse();
  for (int k = 0; k < n; ++k) {
    Transform T_VC = T_0V * problem.pose(k);
    T_VC.translation /= unit;
    if (!T_VC.isFinite()) result->failure = "the structure is not finite";
    result->T_VC.push_back(T_VC);
  }
  for (std::size_t t = 0; t < problem.tracks.size(); ++t)
    result->landmarks.push_back(
        StructureLandmark{problem.tracks[t].id, (T_0V * problem.landmarks[t].point()) / unit});
  result->pose_covariance = structurePoseCovariance(problem, pixelSigma(problem, result->rms_px));
  if (result->pose_covariance.size() == 0) {
    result->failure = "the tracks do not tie the keyframes together";
    return;
  }
  Eigen::VectorXd scale(6 * n);
  for (int k = 0; k < n; ++k) scale.segment<6>(6 * k) << Vector3d::Constant(1.0 / unit), Vector3d::Ones();
  result->pose_covariance = (scale.asDiagonal() * result->pose_covariance * scale.asDiagonal()).eval();
}

}  // namespace

StructureResult structureFromMotion(const std::vector<FeatureFrame>& keyframes,
                                    const std::vector<Quaterniond>& R_VC, const StructureOptions& options) {
  StructureResult result;
  result.failure = checkInput(keyframes, R_VC);
  if (!result.ok()) return result;
  const std::vector<StructureTrack> tracks =
      selectTracks(keyframes, options.min_track_length, options.features_per_keyframe);
  result.tracks_used = static_cast<int>(tracks.size());
  result.failure = checkTracks(tracks, keyframes.size(), options);
  result.tracks_missing = !result.ok();
  if (!result.ok()) return result;

  std::vector<Quaterniond> R_0C;
  for (const Quaterniond& rotation : R_VC) R_0C.push_back((R_VC[0].conjugate() * rotation).normalized());
  const std::optional<double> parallax_px = translationalParallaxPx(keyframes, R_0C);
  result.tracks_missing = !parallax_px;
  if (!parallax_px) {
    result.failure = "no two keyframes see enough points in common: tracks are too short";
    return result;
  }
  result.parallax_px = *parallax_px;
  if (result.parallax_px < options.min_parallax_px) {
    std::ostringstream reason;
    reason.precision(2);
    reason << "the camera has not translated enough: parallax " << result.parallax_px << " px, needs "
           << options.min_parallax_px << " px";
    result.failure = reason.str();
    return result;
  }
  const KnownRotationStructure linear = solveKnownRotations(tracks, R_0C);
  if (!linear.ok) {
    result.failure = "the camera positions are not determined by the tracks";
    return result;
  }
  StructureProblem problem = startProblem(tracks, R_0C, linear);
  result.failure = adjust(tracks, options, &problem, &result);
  result.tracks_dropped = result.tracks_used - static_cast<int>(problem.tracks.size());
  if (result.ok()) fillResult(problem, &result);
  return result;
}

}  // namespace autocal_vio
