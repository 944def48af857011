#include "autocal_vio/frontend/two_view_hypotheses.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

using Random = std::minstd_rand;  // the same numbers on every platform

constexpr int kRotationSamples = 48;
constexpr int kMinEpipolarSamples = 40;
// Parallax moves points off a rotation-only model: those up to this many thresholds away still have a say.
constexpr double kRotationReach = 25.0;

int drawIndex(Random* random, std::size_t count) {
  return static_cast<int>((*random)() % count);
}

Vector3d drawDirection(Random* random) {
  const double scale = 2.0 / static_cast<double>(Random::max());
  Vector3d v;
  do {
    for (int k = 0; k < 3; ++k) v(k) = scale * static_cast<double>((*random)()) - 1.0;
  } while (v.squaredNorm() > 1.0 || v.squaredNorm() < 1e-3);
  return v.normalized();
}

// Two unit vectors normal to a unit vector.
void tangentBasis(const Vector3d& n, Vector3d* u, Vector3d* v) {
  *u = n.unitOrthogonal();
  *v = n.cross(*u);
}

// Orthonormal triad spanned by two bearings, symmetric in both.
bool triad(const Vector3d& a, const Vector3d& b, Matrix3d* M) {
  const Vector3d sum = a + b, difference = a - b;
  if (sum.squaredNorm() < 1e-8 || difference.squaredNorm() < 1e-8) return false;
  M->col(0) = sum.normalized();
  M->col(1) = difference.normalized();
  M->col(2) = M->col(0).cross(M->col(1));
  return true;
}

TwoViewHypothesis bestRotation(const std::vector<BearingPair>& pairs, double threshold, Random* random) {
  TwoViewHypothesis best;
  best.cost = std::numeric_limits<double>::infinity();
  const double reach = kRotationReach * threshold;
  for (int i = 0; i < kRotationSamples; ++i) {
    const BearingPair& a = pairs[drawIndex(random, pairs.size())];
    const BearingPair& b = pairs[drawIndex(random, pairs.size())];
    Matrix3d M1, M2;
    if (!triad(a.f1, b.f1, &M1) || !triad(a.f2, b.f2, &M2)) continue;
    const Matrix3d R = M1 * M2.transpose();
    double cost = 0.0;
    for (const BearingPair& pair : pairs) cost += std::min((pair.f1 - R * pair.f2).norm(), reach);
    if (cost >= best.cost) continue;
    best.cost = cost;
    best.R_C1_C2 = Quaterniond(R);
  }
  const Matrix3d R = best.R_C1_C2.toRotationMatrix();
  best.cost = 0.0;
  for (const BearingPair& pair : pairs)
    best.cost += std::min((pair.f1 - R * pair.f2).squaredNorm(), threshold * threshold);
  return best;
}

// Direction t least at odds with the sample's epipolar planes, rotation given.
Vector3d linearDirection(const std::vector<BearingPair>& pairs, const int (&sample)[5],
                         const Quaterniond& R) {
  Matrix3d M = Matrix3d::Zero();
  for (int i : sample) {
    const Vector3d n = (R * pairs[i].f2).cross(pairs[i].f1);
    M += n * n.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Matrix3d> solver;
  solver.computeDirect(M);
  return solver.eigenvectors().col(0);
}

// Truncated squared angle between f1 and its epipolar plane, summed; `inliers` are those below the threshold.
double epipolarCost(const std::vector<BearingPair>& pairs, const TwoViewHypothesis& hypothesis,
                    double threshold, int* inliers) {
  const Matrix3d R = hypothesis.R_C1_C2.toRotationMatrix();
  const double limit = threshold * threshold;
  double cost = 0.0;
  *inliers = 0;
  for (const BearingPair& pair : pairs) {
    const Vector3d b = R * pair.f2;
    const Vector3d n = hypothesis.direction_C1.cross(b);
    const double error = pair.f1.dot(n);
    const double squared = error * error / std::max(n.squaredNorm(), 1e-12);
    if (squared < limit && pair.f1.dot(b) > 0.0) {
      cost += squared;
      ++*inliers;
    } else {
      cost += limit;
    }
  }
  return cost;
}

// Keeps `kept` in ascending order of cost, at most `size` of them, no two of the same rotation.
void keepDistinct(const TwoViewHypothesis& candidate, double min_angle, std::size_t size,
                  std::vector<TwoViewHypothesis>* kept) {
  for (auto it = kept->begin(); it != kept->end(); ++it) {
    if (it->R_C1_C2.angularDistance(candidate.R_C1_C2) > min_angle) continue;
    if (it->cost <= candidate.cost) return;
    kept->erase(it);
    break;
  }
  auto place = std::find_if(kept->begin(), kept->end(),
                            [&](const TwoViewHypothesis& other) { return other.cost > candidate.cost; });
  kept->insert(place, candidate);
  if (kept->size() > size) kept->pop_back();
}

// Samples needed to see one without outliers, with 99.99 %.
int neededSamples(double inlier_ratio) {
  const double clean = std::pow(inlier_ratio, 5);
  if (clean > 0.999) return 1;
  if (clean < 1e-6) return std::numeric_limits<int>::max();
  return static_cast<int>(std::ceil(std::log(1e-4) / std::log(1.0 - clean)));
}

}  // namespace

std::vector<BearingPair> makeBearingPairs(const std::vector<Eigen::Vector2d>& points1,
                                          const std::vector<Eigen::Vector2d>& points2) {
  std::vector<BearingPair> pairs(std::min(points1.size(), points2.size()));
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    BearingPair& pair = pairs[i];
    pair.f1 = points1[i].homogeneous().normalized();
    pair.f2 = points2[i].homogeneous().normalized();
    Vector3d u, v;
    tangentBasis(pair.f1, &u, &v);
    pair.tangent1 << u.transpose(), v.transpose();
  }
  return pairs;
}

bool solveFivePoints(const std::vector<BearingPair>& pairs, const int (&sample)[5],
                     TwoViewHypothesis* hypothesis) {
  using Matrix5d = Eigen::Matrix<double, 5, 5>;
  using Vector5d = Eigen::Matrix<double, 5, 1>;
  for (int iteration = 0; iteration < 10; ++iteration) {
    const Matrix3d R = hypothesis->R_C1_C2.toRotationMatrix();
    const Vector3d t = hypothesis->direction_C1;
    Vector3d u, v;
    tangentBasis(t, &u, &v);
    Matrix5d J;
    Vector5d r;
    for (int k = 0; k < 5; ++k) {
      const BearingPair& pair = pairs[sample[k]];
      const Vector3d b = R * pair.f2;
      const Vector3d n = b.cross(pair.f1);
      r(k) = t.dot(n);
      // d (R f2) = -R [f2]x dtheta = R (dtheta x f2)
      J.block<1, 3>(k, 0) = pair.f2.cross(R.transpose() * pair.f1.cross(t)).transpose();
      J(k, 3) = u.dot(n);
      J(k, 4) = v.dot(n);
    }
    if (r.squaredNorm() < 1e-22) return true;
    Matrix5d H = J.transpose() * J;
    H.diagonal().array() += 1e-14;  // a sample may be degenerate
    const Vector5d step = -H.ldlt().solve(J.transpose() * r);
    if (!step.allFinite() || step.squaredNorm() > 4.0) return false;
    hypothesis->R_C1_C2 = (hypothesis->R_C1_C2 * expSo3(step.head<3>().eval())).normalized();
    hypothesis->direction_C1 = (t + step(3) * u + step(4) * v).normalized();
    if (step.squaredNorm() < 1e-14) return r.squaredNorm() < 1e-10;
  }
  return false;
}

std::vector<TwoViewHypothesis> drawTwoViewHypotheses(const std::vector<BearingPair>& pairs,
                                                     const HypothesisOptions& options) {
  Random random(options.seed);
  std::vector<TwoViewHypothesis> result{bestRotation(pairs, options.threshold, &random)};
  std::vector<TwoViewHypothesis> kept;
  int needed = options.max_epipolar;
  for (int i = 0; i < options.max_epipolar && i < std::max(needed, kMinEpipolarSamples); ++i) {
    int sample[5];
    for (int k = 0; k < 5; ++k) {
      do sample[k] = drawIndex(&random, pairs.size());
      while (std::find(sample, sample + k, sample[k]) != sample + k);
    }
    TwoViewHypothesis hypothesis = result.front();
    hypothesis.direction_C1 =
        i % 2 == 0 ? linearDirection(pairs, sample, hypothesis.R_C1_C2) : drawDirection(&random);
    if (!solveFivePoints(pairs, sample, &hypothesis)) continue;
    int inliers = 0;
    hypothesis.cost = epipolarCost(pairs, hypothesis, options.threshold, &inliers);
    const bool best = kept.empty() || hypothesis.cost < kept.front().cost;
    keepDistinct(hypothesis, 2.0 * options.threshold, static_cast<std::size_t>(options.kept), &kept);
    if (best) needed = neededSamples(static_cast<double>(inliers) / static_cast<double>(pairs.size()));
  }
  result.insert(result.end(), kept.begin(), kept.end());
  return result;
}

}  // namespace autocal_vio
