#include <gtest/gtest.h>

#include <Eigen/LU>
#include <ctime>
#include <random>

#include "autocal_vio/frontend/two_view.h"
#include "autocal_vio/frontend/two_view_refinement.h"
#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPixel = 1.0 / 450.0;  // [rad]
constexpr double kPi = 3.14159265358979323846;

enum class Scene { kRoom, kGround, kWall, kFar };

struct Case {
  Scene scene = Scene::kRoom;
  int points = 150;
  double noise = 0.0;     // of each coordinate in each view [px]
  double outliers = 0.0;  // share of wrong tracks
  double angle = 0.12;    // [rad]
  double baseline = 0.4;  // [m]
};

struct Views {
  std::vector<Vector2d> points1, points2;
  Quaterniond R_C1_C2;
  Vector3d p_C1_C2;
  std::vector<bool> wrong;
};

// A point in C1 within a 752x480 image of 450 px focal length.
Vector3d drawPoint(Scene scene, std::mt19937* random) {
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const double x = 0.8 * (2.0 * unit(*random) - 1.0), y = 0.5 * (2.0 * unit(*random) - 1.0);
  double depth = 2.0 + 8.0 * unit(*random);
  if (scene == Scene::kGround) depth = 3.0 / (0.7 + y);
  if (scene == Scene::kWall) depth = 4.0 / (1.0 + 0.3 * x + 0.2 * y);
  if (scene == Scene::kFar) depth = 1e9 * (1.0 + unit(*random));
  return depth * Vector3d(x, y, 1.0);
}

Vector3d drawDirection(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return Vector3d(normal(*random), normal(*random), normal(*random)).normalized();
}

Views makeViews(const Case& c, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Views views;
  views.R_C1_C2 = expSo3((c.angle * drawDirection(&random)).eval());
  views.p_C1_C2 = c.baseline * drawDirection(&random);
  while (static_cast<int>(views.points1.size()) < c.points) {
    const Vector3d p1 = drawPoint(c.scene, &random);
    const Vector3d p2 = views.R_C1_C2.conjugate() * (p1 - views.p_C1_C2);
    if (p2.z() < 0.3) continue;
    const Vector2d noise1(normal(random), normal(random)), noise2(normal(random), normal(random));
    views.points1.push_back(p1.hnormalized() + c.noise * kPixel * noise1);
    views.points2.push_back(p2.hnormalized() + c.noise * kPixel * noise2);
    const bool wrong = unit(random) < c.outliers;
    if (wrong) views.points2.back() = Vector2d(1.6 * unit(random) - 0.8, unit(random) - 0.5);
    views.wrong.push_back(wrong);
  }
  return views;
}

Vector3d rotationError(const TwoViewRotation& estimate, const Views& truth) {
  return logSo3((truth.R_C1_C2.conjugate() * estimate.R_C1_C2).normalized());
}

double nees(const TwoViewRotation& estimate, const Views& truth) {
  const Vector3d error = rotationError(estimate, truth);
  return error.dot(estimate.covariance.inverse() * error);
}

class TwoViewExact : public testing::TestWithParam<Case> {};

TEST_P(TwoViewExact, RotationIsExact) {
  int tried = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Views views = makeViews(GetParam(), seed);
    const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
    const bool plane = GetParam().scene == Scene::kWall || GetParam().scene == Scene::kGround;
    if (!result.rotation && plane) continue;  // may leave two answers
    ASSERT_TRUE(result.rotation) << result.reason;
    EXPECT_LT(rotationError(*result.rotation, views).norm(), 2e-9) << "seed " << seed;
    ++tried;
  }
  EXPECT_GE(tried, GetParam().scene == Scene::kRoom || GetParam().scene == Scene::kFar ? 20 : 5);
}

INSTANTIATE_TEST_SUITE_P(Scenes, TwoViewExact,
                         testing::Values(Case{Scene::kRoom}, Case{Scene::kGround}, Case{Scene::kWall},
                                         Case{Scene::kFar}, Case{Scene::kRoom, 150, 0.0, 0.0, 0.3, 0.0},
                                         Case{Scene::kRoom, 20, 0.0, 0.0, 0.1, 0.3},
                                         Case{Scene::kRoom, 150, 0.0, 0.3, 0.1, 0.5},
                                         Case{Scene::kRoom, 150, 0.0, 0.3, 0.1, 0.0},
                                         Case{Scene::kRoom, 150, 0.0, 0.0, 0.0, 0.0}));

struct NoisyCase {
  const char* name;
  Case scene;
  double worst_deg;
};

class TwoViewNoisy : public testing::TestWithParam<NoisyCase> {};

// docs/derivation.md (D48), with all else that is in the covariance.
TEST_P(TwoViewNoisy, ErrorIsSmallAndWithinCovariance) {
  double sum = 0.0, worst = 0.0, mean_sigma = 0.0;
  int count = 0, refused = 0;
  const int seeds = 100;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const Views views = makeViews(GetParam().scene, seed);
    const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
    if (!result.rotation) {
      ++refused;
      continue;
    }
    ++count;
    sum += nees(*result.rotation, views);
    worst = std::max(worst, rotationError(*result.rotation, views).norm() * 180.0 / kPi);
    mean_sigma += std::sqrt(result.rotation->covariance.trace() / 3.0) * 180.0 / kPi;
  }
  const double mean = sum / count;
  RecordProperty("mean_nees", std::to_string(mean));
  RecordProperty("worst_deg", std::to_string(worst));
  std::printf("%-22s mean NEES %.2f (3 expected), worst %.3f deg, mean sigma %.3f deg, refused %d\n",
              GetParam().name, mean, worst, mean_sigma / count, refused);
  // A plane may leave two answers.
  EXPECT_LE(refused, GetParam().scene.scene == Scene::kRoom ? 2 : 80);
  // Never overconfident; with little or no parallax the weak prior makes it cautious.
  EXPECT_LT(mean, 6.0);
  EXPECT_GT(mean, 0.2);
  EXPECT_LT(worst, GetParam().worst_deg);
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, TwoViewNoisy,
    testing::Values(NoisyCase{"room", {Scene::kRoom, 150, 0.3}, 0.35},
                    NoisyCase{"room, small parallax", {Scene::kRoom, 150, 0.3, 0.0, 0.05, 0.02}, 0.35},
                    NoisyCase{"room, medium parallax", {Scene::kRoom, 150, 0.3, 0.0, 0.05, 0.08}, 0.35},
                    NoisyCase{"room, pure rotation", {Scene::kRoom, 150, 0.3, 0.0, 0.2, 0.0}, 0.2},
                    NoisyCase{"ground", {Scene::kGround, 150, 0.3}, 0.5},
                    NoisyCase{"ground, small parallax", {Scene::kGround, 150, 0.3, 0.0, 0.1, 0.05}, 0.5},
                    NoisyCase{"wall", {Scene::kWall, 150, 0.3, 0.0, 0.12, 0.4}, 0.6},
                    NoisyCase{"outliers", {Scene::kRoom, 150, 0.3, 0.3}, 0.5},
                    NoisyCase{"outliers, rotation", {Scene::kRoom, 150, 0.3, 0.3, 0.2, 0.0}, 0.3},
                    NoisyCase{"few points", {Scene::kRoom, 40, 0.3}, 0.8}),
    [](const testing::TestParamInfo<NoisyCase>& test_case) {
      std::string name;
      for (const char* c = test_case.param.name; *c != 0; ++c)
        if (std::isalnum(static_cast<unsigned char>(*c))) name += *c;
      return name;
    });

TEST(TwoView, MarksWrongTracks) {
  const Views views = makeViews({Scene::kRoom, 150, 0.3, 0.3}, 3);
  const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
  ASSERT_TRUE(result.rotation) << result.reason;
  int missed = 0, lost = 0;
  for (std::size_t i = 0; i < views.wrong.size(); ++i) {
    missed += views.wrong[i] && result.rotation->inlier_mask[i];
    lost += !views.wrong[i] && !result.rotation->inlier_mask[i];
  }
  EXPECT_LE(missed, 5);  // a wrong point may lie on its epipolar line by chance
  EXPECT_LE(lost, 1);
  EXPECT_TRUE(result.rotation->parallax);
  EXPECT_GT(std::abs(result.rotation->parallax_C1.normalized().dot(views.p_C1_C2.normalized())), 0.99);
  EXPECT_GT(result.rotation->parallax_C1.dot(views.p_C1_C2), 0.0);
}

TEST(TwoView, PredictionChoosesBetweenThePlanesTwoRotations) {
  int refused = 0, rescued = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    const Views views = makeViews({Scene::kGround, 150, 0.3}, seed);
    refused += !estimateTwoViewRotation(views.points1, views.points2).rotation;
    TwoViewOptions options;
    options.R_C1_C2_prediction = views.R_C1_C2 * expSo3(Vector3d(0.002, -0.002, 0.002));
    const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2, options);
    if (!result.rotation) continue;  // it may lie between the two
    EXPECT_LT(rotationError(*result.rotation, views).norm(), 0.01) << "seed " << seed;
    ++rescued;
  }
  EXPECT_GT(refused, 5);
  EXPECT_GT(rescued, 35);
}

TEST(TwoView, NoParallaxWithoutTranslation) {
  const Views views = makeViews({Scene::kRoom, 150, 0.3, 0.0, 0.2, 0.0}, 5);
  const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
  ASSERT_TRUE(result.rotation) << result.reason;
  EXPECT_FALSE(result.rotation->parallax);
}

TEST(TwoView, NoiseLevelIsFound) {
  const Views views = makeViews({Scene::kRoom, 150, 0.3}, 7);
  const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
  ASSERT_TRUE(result.rotation) << result.reason;
  // Both views' noise meets in one residual; bearings shrink it off the axis.
  EXPECT_NEAR(result.rotation->sigma / kPixel, 0.3 * std::sqrt(2.0) * 0.85, 0.1);
}

TEST(TwoView, RefusesWhatItCannotKnow) {
  const Views few = makeViews({Scene::kRoom, 9, 0.0}, 1);
  TwoViewResult result = estimateTwoViewRotation(few.points1, few.points2);
  EXPECT_FALSE(result.rotation);
  EXPECT_NE(result.reason.find("only 9 common points"), std::string::npos) << result.reason;
  EXPECT_FALSE(estimateTwoViewRotation({}, {}).rotation);

  Views wrong = makeViews({Scene::kRoom, 100, 0.0, 1.0}, 2);
  result = estimateTwoViewRotation(wrong.points1, wrong.points2);
  EXPECT_FALSE(result.rotation);
  EXPECT_NE(result.reason.find("agree"), std::string::npos) << result.reason;

  Views views = makeViews({Scene::kRoom, 100, 0.0}, 3);
  views.points2.pop_back();
  EXPECT_FALSE(estimateTwoViewRotation(views.points1, views.points2).rotation);
  views.points2.push_back(Vector2d(std::nan(""), 0.0));
  EXPECT_FALSE(estimateTwoViewRotation(views.points1, views.points2).rotation);

  const std::vector<Vector2d> same(100, Vector2d(0.1, 0.2));
  EXPECT_FALSE(estimateTwoViewRotation(same, same).rotation);
}

TEST(TwoView, SameInputSameOutput) {
  const Views views = makeViews({Scene::kRoom, 150, 0.3, 0.3}, 11);
  const TwoViewResult a = estimateTwoViewRotation(views.points1, views.points2);
  const TwoViewResult b = estimateTwoViewRotation(views.points1, views.points2);
  ASSERT_TRUE(a.rotation && b.rotation);
  EXPECT_EQ(a.rotation->R_C1_C2.coeffs(), b.rotation->R_C1_C2.coeffs());
  EXPECT_EQ(a.rotation->covariance, b.rotation->covariance);
  EXPECT_EQ(a.rotation->inlier_mask, b.rotation->inlier_mask);
}

TEST(TwoView, PointJacobiansMatchDifferences) {
  const Views views = makeViews({Scene::kRoom, 20, 0.3}, 4);
  const std::vector<BearingPair> pairs = makeBearingPairs(views.points1, views.points2);
  TwoViewGeometry geometry;
  geometry.R_C1_C2 = views.R_C1_C2;
  geometry.parallax_C1 = 0.2 * views.p_C1_C2;
  const double h = 1e-6;
  for (const BearingPair& pair : pairs) {
    const PointResidual at = evaluatePoint(pair, geometry, NoiseLevel());
    const auto errorAt = [&](const TwoViewGeometry& g, double w) {
      return Vector2d(pair.tangent1 * (g.R_C1_C2 * pair.f2 + w * g.parallax_C1).normalized());
    };
    for (int k = 0; k < 6; ++k) {
      TwoViewGeometry plus = geometry, minus = geometry;
      if (k < 3) {
        plus.R_C1_C2 = geometry.R_C1_C2 * expSo3((h * Vector3d::Unit(k)).eval());
        minus.R_C1_C2 = geometry.R_C1_C2 * expSo3((-h * Vector3d::Unit(k)).eval());
      } else {
        plus.parallax_C1 += h * Vector3d::Unit(k - 3);
        minus.parallax_C1 -= h * Vector3d::Unit(k - 3);
      }
      const Vector2d numeric = (errorAt(plus, at.w) - errorAt(minus, at.w)) / (2.0 * h);
      EXPECT_LT((numeric - at.jacobian.col(k)).norm(), 1e-8);
    }
    const Vector2d by_w = (errorAt(geometry, at.w + h) - errorAt(geometry, at.w - h)) / (2.0 * h);
    EXPECT_LT((by_w - at.by_w).norm(), 1e-8);
  }
}

TEST(TwoView, CostsLittle) {
  const Views views = makeViews({Scene::kRoom, 150, 0.3, 0.1}, 13);
  const std::clock_t begin = std::clock();  // CPU time: the machine may be busy
  for (unsigned i = 0; i < 20; ++i)
    ASSERT_TRUE(estimateTwoViewRotation(views.points1, views.points2).rotation);
  const double ms = 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC / 20;
  std::printf("%.2f ms for 150 points\n", ms);
#ifdef AUTOCAL_VIO_OPTIMIZED
  EXPECT_LT(ms, 50.0);  // loose: slow machines; the target is 3 ms
#endif
}

// Mean of the points' inverse distances from C2 [1/m]: what turns a translation into a mean parallax.
double meanInverseDistance(const Views& views) {
  const Matrix3d R = views.R_C1_C2.toRotationMatrix();
  double sum = 0.0;
  for (std::size_t i = 0; i < views.points1.size(); ++i) {
    // Depths from p1 = R p2 + t, both along their rays.
    Eigen::Matrix<double, 3, 2> rays;
    rays << views.points1[i].homogeneous(), -(R * views.points2[i].homogeneous());
    const Vector2d depths = (rays.transpose() * rays).ldlt().solve(rays.transpose() * views.p_C1_C2);
    sum += 1.0 / (depths(1) * views.points2[i].homogeneous().norm());
  }
  return sum / static_cast<double>(views.points1.size());
}

// docs/derivation.md (D42).
TEST(TwoView, TellsHowMuchOfASmallParallaxItTakesForRotation) {
  double along = 0.0, predicted = 0.0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Case c;
    c.baseline = 0.01;
    const double inverse_distance = meanInverseDistance(makeViews(c, seed));  // without noise
    c.noise = 0.5;
    const Views views = makeViews(c, seed);
    const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
    ASSERT_TRUE(result.rotation) << result.reason;
    const Vector3d expected = result.rotation->rotation_by_parallax * views.p_C1_C2 * inverse_distance;
    along += expected.dot(rotationError(*result.rotation, views));
    predicted += expected.squaredNorm();
  }
  const double rms_deg = std::sqrt(predicted / 100.0) * 180.0 / kPi;
  std::printf("predicted %.3f deg (rms); of that there is %.2f\n", rms_deg, along / predicted);
  EXPECT_GT(rms_deg, 0.03);
  EXPECT_NEAR(along / predicted, 1.0, 0.3);
}

// docs/derivation.md (D42).
TEST(TwoView, TakesNextToNothingOfAClearParallaxForRotation) {
  double mean = 0.0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Case c;
    c.noise = 0.5;
    const Views views = makeViews(c, seed);
    const TwoViewResult result = estimateTwoViewRotation(views.points1, views.points2);
    ASSERT_TRUE(result.rotation) << result.reason;
    mean += result.rotation->rotation_by_parallax.norm() / 100.0;
  }
  EXPECT_LT(mean, 0.02);
}

}  // namespace
}  // namespace autocal_vio
