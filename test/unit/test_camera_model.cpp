#include "autocal_vio/camera/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <stdexcept>

#include "cameras.h"
#include "numeric_jacobian.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using test::numericJacobian;
using test::RandomStates;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Distorted normalised coordinates by the models' published formulas, written with angles and without any of
// the implementation's shortcuts.
Vector2d referencePixel(const CameraIntrinsics& c, const Vector3d& point) {
  const Eigen::Vector4d& k = c.distortion_coeffs;
  const double x = point.x() / point.z(), y = point.y() / point.z(), r = std::hypot(x, y);
  Vector2d d;
  if (c.distortion_model == DistortionModel::kRadialTangential) {
    const Eigen::Vector4d& h = c.higher_radial_coeffs;
    const double radial = (1.0 + k(0) * std::pow(r, 2) + k(1) * std::pow(r, 4) + h(0) * std::pow(r, 6)) /
                          (1.0 + h(1) * std::pow(r, 2) + h(2) * std::pow(r, 4) + h(3) * std::pow(r, 6));
    d.x() = x * radial + 2.0 * k(2) * x * y + k(3) * (r * r + 2.0 * x * x);
    d.y() = y * radial + k(2) * (r * r + 2.0 * y * y) + 2.0 * k(3) * x * y;
  } else {
    const double theta = std::atan2(point.head<2>().norm(), point.z()),
                 azimuth = std::atan2(point.y(), point.x());
    const double theta_d = theta + k(0) * std::pow(theta, 3) + k(1) * std::pow(theta, 5) +
                           k(2) * std::pow(theta, 7) + k(3) * std::pow(theta, 9);
    d << theta_d * std::cos(azimuth), theta_d * std::sin(azimuth);
  }
  return Vector2d(c.intrinsics(0) * d.x() + c.intrinsics(2), c.intrinsics(1) * d.y() + c.intrinsics(3));
}

class CameraModelOf : public ::testing::TestWithParam<CameraIntrinsics> {
 protected:
  CameraModelOf() : camera_(GetParam()) {}

  // A point that is seen, at 0.05 to 50 m.
  Vector3d visiblePoint(RandomStates* random) const {
    const double reach = GetParam().distortion_model == DistortionModel::kEquidistant ? 4.0 : 0.9;
    const double x = random->uniform(-reach, reach), y = random->uniform(-reach, reach);
    return std::pow(10.0, random->uniform(-1.3, 1.7)) * Vector3d(x, y, 1.0);
  }

  CameraModel camera_;
};

TEST_P(CameraModelOf, AgreesWithTheModelsFormula) {
  RandomStates random(1);
  for (int i = 0; i < 500; ++i) {
    const Vector3d point = visiblePoint(&random);
    Vector2d pixel;
    ASSERT_TRUE(camera_.project(point, &pixel));
    EXPECT_LT((pixel - referencePixel(GetParam(), point)).norm(), 1e-11);
  }
}

TEST_P(CameraModelOf, UndistortionRoundTripOverTheWholeImage) {
  const Eigen::Vector4d& c = GetParam().intrinsics;
  // Only the fisheye's corners show what is more than 83 deg off the axis (x/z of 8), and just those are
  // refused.
  const double limit = (referencePixel(GetParam(), Vector3d(8.0, 0.0, 1.0)).x() - c(2)) / c(0);
  int refused = 0;
  for (double v = -0.5; v <= camera_.height() - 0.5; v += 4.0) {
    for (double u = -0.5; u <= camera_.width() - 0.5; u += 4.0) {
      const Vector2d pixel(u, v);
      const std::optional<Vector2d> normalized = camera_.undistort(pixel);
      if (!normalized) {
        EXPECT_GT((pixel - c.tail<2>()).cwiseQuotient(c.head<2>()).norm(), limit) << pixel.transpose();
        ++refused;
        continue;
      }
      Vector2d back;
      ASSERT_TRUE(camera_.distort(*normalized, &back));
      ASSERT_LT((back - pixel).norm(), 1e-9) << pixel.transpose();
      ASSERT_TRUE(camera_.project(Vector3d(3.7 * normalized->x(), 3.7 * normalized->y(), 3.7), &back));
      ASSERT_LT((back - pixel).norm(), 1e-9) << pixel.transpose();
    }
  }
  EXPECT_EQ(refused > 0, GetParam().distortion_model == DistortionModel::kEquidistant);
}

TEST_P(CameraModelOf, ProjectionRoundTrip) {
  RandomStates random(2);
  for (int i = 0; i < 500; ++i) {
    const Vector3d point = visiblePoint(&random);
    Vector2d pixel;
    ASSERT_TRUE(camera_.project(point, &pixel));
    const std::optional<Vector2d> normalized = camera_.undistort(pixel);
    ASSERT_TRUE(normalized);
    const double r2 = normalized->squaredNorm();  // far off the axis a pixel covers more of the plane
    EXPECT_LT((*normalized - point.hnormalized()).norm(), 1e-12 * (1.0 + r2));
  }
}

TEST_P(CameraModelOf, DistortionJacobianAgainstDifferences) {
  RandomStates random(3);
  for (int i = 0; i < 200; ++i) {
    const Vector2d normalized =
        i == 0 ? Vector2d(Vector2d::Zero()) : Vector2d(visiblePoint(&random).hnormalized());
    Vector2d pixel, same;
    Matrix2d J;
    ASSERT_TRUE(camera_.distort(normalized, &pixel, &J));
    ASSERT_TRUE(camera_.distort(normalized, &same));
    EXPECT_EQ(pixel, same);
    const auto f = [&](const Vector2d& m) -> Vector2d {
      Vector2d p = Vector2d::Constant(kNaN);
      camera_.distort(m, &p);
      return p;
    };
    const Matrix2d numeric = numericJacobian<2, 2>(f, normalized, 1e-3);
    EXPECT_LT((J - numeric).norm(), 1e-8 * J.norm()) << normalized.transpose();
  }
}

TEST_P(CameraModelOf, ProjectionJacobianAgainstDifferences) {
  RandomStates random(4);
  for (int i = 0; i < 200; ++i) {
    const Vector3d point = i == 0 ? Vector3d(0.0, 0.0, 2.0) : visiblePoint(&random);
    Vector2d pixel;
    Matrix23d J;
    ASSERT_TRUE(camera_.project(point, &pixel, &J));
    const auto f = [&](const Vector3d& p) -> Vector2d {
      Vector2d result = Vector2d::Constant(kNaN);
      camera_.project(p, &result);
      return result;
    };
    const Matrix23d numeric = numericJacobian<2, 3>(f, point, 1e-3 * point.z());
    EXPECT_LT((J - numeric).norm(), 1e-8 * J.norm()) << point.transpose();
    // Along its own ray a point does not move in the image.
    EXPECT_LT((J * point).norm(), 1e-12 * J.norm() * point.norm());
  }
}

TEST_P(CameraModelOf, JacobianIsContinuousAtTheAxis) {
  for (const double r : {0.0, 1e-12, 9e-9, 1.1e-8, 1e-6}) {
    Vector2d pixel;
    Matrix2d J;
    ASSERT_TRUE(camera_.distort(Vector2d(r, -r), &pixel, &J));
    const Matrix2d expected = GetParam().intrinsics.head<2>().asDiagonal();
    EXPECT_LT((J - expected).norm(), 2e-6 * 460.0 * (r / 1e-6) + 1e-9) << r;
    EXPECT_LT((pixel - GetParam().intrinsics.tail<2>() - expected * Vector2d(r, -r)).norm(), 1e-9) << r;
  }
}

TEST_P(CameraModelOf, RefusesPointsThatAreNotInFront) {
  const Vector2d untouched(-7.0, -8.0);
  const Matrix23d untouched_J = Matrix23d::Constant(-9.0);
  for (const Vector3d& point :
       {Vector3d(0.1, 0.1, -1.0), Vector3d(0.0, 0.0, 0.0), Vector3d(1.0, 0.0, 0.0), Vector3d(0.0, 0.0, -1e-9),
        Vector3d(kNaN, 0.0, 1.0), Vector3d(0.0, kNaN, 1.0), Vector3d(0.0, 0.0, kNaN),
        Vector3d(kInfinity, 0.0, 1.0), Vector3d(kInfinity, 0.0, kInfinity), Vector3d(8.1, 0.0, 1.0),
        Vector3d(-1e6, 1e6, 1.0)}) {
    Vector2d pixel = untouched;
    Matrix23d J = untouched_J;
    EXPECT_FALSE(camera_.project(point, &pixel, &J)) << point.transpose();
    EXPECT_EQ(pixel, untouched);
    EXPECT_EQ(J, untouched_J);
  }
}

TEST_P(CameraModelOf, RefusesPixelsThatCannotBeUndistorted) {
  for (const Vector2d& pixel : {Vector2d(kNaN, 1.0), Vector2d(1.0, kNaN), Vector2d(kInfinity, 1.0),
                                Vector2d(1e9, -1e9), Vector2d(0.0, 1e300)})
    EXPECT_FALSE(camera_.undistort(pixel)) << pixel.transpose();
}

TEST_P(CameraModelOf, HasNothingToComplainAbout) {
  EXPECT_TRUE(GetParam().validate().empty());
}

std::string modelName(const ::testing::TestParamInfo<CameraIntrinsics>& info) {
  const char* const names[] = {"EurocRadtan", "TumViEquidistant", "PlumbBob", "Rational"};
  return names[info.index];
}

INSTANTIATE_TEST_SUITE_P(Calibrations, CameraModelOf,
                         ::testing::Values(test::eurocIntrinsics(), test::tumViIntrinsics(),
                                           test::plumbBobIntrinsics(), test::rationalIntrinsics()),
                         modelName);

// Somebody else's implementation of the same models.
TEST(CameraModel, AgreesWithOpenCV) {
  for (const CameraIntrinsics& c :
       {test::eurocIntrinsics(), test::plumbBobIntrinsics(), test::rationalIntrinsics()}) {
    const CameraModel camera(c);
    const cv::Matx33d K(c.intrinsics(0), 0.0, c.intrinsics(2), 0.0, c.intrinsics(1), c.intrinsics(3), 0.0,
                        0.0, 1.0);
    std::vector<double> D(c.distortion_coeffs.data(), c.distortion_coeffs.data() + 4);
    D.insert(D.end(), c.higher_radial_coeffs.data(), c.higher_radial_coeffs.data() + 4);
    RandomStates random(5);
    for (int i = 0; i < 100; ++i) {
      const Vector3d point(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), random.uniform(1.2, 10.0));
      std::vector<cv::Point2d> pixels;
      cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, cv::Vec3d(), cv::Vec3d(),
                        K, D, pixels);
      Vector2d pixel;
      ASSERT_TRUE(camera.project(point, &pixel));
      EXPECT_LT((pixel - Vector2d(pixels[0].x, pixels[0].y)).norm(), 1e-10);
    }
  }
}

TEST(CameraModel, RefusesWhereTheRationalFactorHasNoValue) {
  CameraIntrinsics intrinsics = test::rationalIntrinsics();
  intrinsics.distortion_coeffs.setZero();
  intrinsics.higher_radial_coeffs << 0.0, -0.5, 0.0, 0.0;  // 1 - 0.5 r^2 = 0 at r = 1.414
  const CameraModel camera(intrinsics);
  Vector2d pixel;
  EXPECT_TRUE(camera.project(Vector3d(1.3, 0.0, 1.0), &pixel));
  EXPECT_FALSE(camera.project(Vector3d(1.43, 0.0, 1.0), &pixel));
  EXPECT_FALSE(camera.project(Vector3d(5.0, 0.0, 1.0), &pixel));
}

TEST(CameraModel, ImageAxes) {
  // x to the right, y down, z forward.
  const CameraModel camera(test::eurocIntrinsics());
  Vector2d centre, right, below;
  ASSERT_TRUE(camera.project(Vector3d(0.0, 0.0, 2.0), &centre));
  ASSERT_TRUE(camera.project(Vector3d(0.02, 0.0, 2.0), &right));
  ASSERT_TRUE(camera.project(Vector3d(0.0, 0.02, 2.0), &below));
  EXPECT_EQ(centre, Vector2d(367.215, 248.375));
  EXPECT_NEAR(right.x() - centre.x(), 4.58654, 1e-3);  // fu * 0.01, less 3e-5 of distortion
  EXPECT_NEAR(right.y(), centre.y(), 1e-4);
  EXPECT_NEAR(below.y() - centre.y(), 4.57296, 1e-3);
  EXPECT_NEAR(below.x(), centre.x(), 1e-4);
  EXPECT_DOUBLE_EQ(camera.focalLength(), 457.975);
}

TEST(CameraModel, RefusesBeyondTheMonotonicRadiusRadtan) {
  CameraIntrinsics intrinsics = test::eurocIntrinsics();
  intrinsics.distortion_coeffs << -0.3, 0.0, 0.0, 0.0;  // d (r - 0.3 r^3) / dr = 0 at r = 1.054
  const CameraModel camera(intrinsics);
  Vector2d pixel;
  EXPECT_TRUE(camera.project(Vector3d(1.03, 0.0, 1.0), &pixel));
  EXPECT_FALSE(camera.project(Vector3d(1.06, 0.0, 1.0), &pixel));
  EXPECT_FALSE(camera.project(Vector3d(0.0, -1.5, 1.0), &pixel));
  // r = 1.05 gives the largest distorted radius there is, 0.7027: nothing lies beyond it.
  const Eigen::Vector4d& c = intrinsics.intrinsics;
  EXPECT_TRUE(camera.undistort(Vector2d(c(2) + 0.70 * c(0), c(3))));
  EXPECT_FALSE(camera.undistort(Vector2d(c(2) + 0.71 * c(0), c(3))));
  EXPECT_FALSE(camera.undistort(Vector2d(c(2) - 2.0 * c(0), c(3) + 2.0 * c(1))));
}

TEST(CameraModel, RefusesBeyondTheMonotonicRadiusEquidistant) {
  CameraIntrinsics intrinsics = test::tumViIntrinsics();
  intrinsics.distortion_coeffs << -0.2, 0.0, 0.0, 0.0;  // d (t - 0.2 t^3) / dt = 0 at t = 1.291, r = 3.48
  const CameraModel camera(intrinsics);
  Vector2d pixel;
  EXPECT_TRUE(camera.project(Vector3d(0.0, 3.44, 1.0), &pixel));
  EXPECT_FALSE(camera.project(Vector3d(0.0, 3.5, 1.0), &pixel));
  const Eigen::Vector4d& c = intrinsics.intrinsics;  // largest distorted radius 0.8607
  EXPECT_TRUE(camera.undistort(Vector2d(c(2), c(3) + 0.85 * c(1))));
  EXPECT_FALSE(camera.undistort(Vector2d(c(2), c(3) + 0.87 * c(1))));
}

TEST(CameraModel, UndistortsTheEdgeOfItsValidRegion) {
  // Found by Newton steps that are held back to the region, also where they start outside of it.
  CameraIntrinsics intrinsics = test::eurocIntrinsics();
  intrinsics.distortion_coeffs << 0.4, 0.3, 0.0, 0.0;  // pincushion: the start lies outside
  const CameraModel camera(intrinsics);
  for (double r = 0.0; r < 7.9; r += 0.1) {
    const Vector2d normalized(r * 0.8, r * 0.6);
    Vector2d pixel;
    ASSERT_TRUE(camera.distort(normalized, &pixel));
    const std::optional<Vector2d> back = camera.undistort(pixel);
    ASSERT_TRUE(back) << r;
    EXPECT_LT((*back - normalized).norm(), 1e-11) << r;
  }
}

TEST(CameraModel, Contains) {
  const CameraModel camera(test::eurocIntrinsics());
  EXPECT_TRUE(camera.contains(Vector2d(0.0, 0.0)));
  EXPECT_TRUE(camera.contains(Vector2d(751.0, 479.0)));
  EXPECT_FALSE(camera.contains(Vector2d(751.1, 479.0)));
  EXPECT_FALSE(camera.contains(Vector2d(10.0, -0.1)));
  EXPECT_TRUE(camera.contains(Vector2d(20.0, 20.0), 20.0));
  EXPECT_FALSE(camera.contains(Vector2d(19.9, 20.0), 20.0));
  EXPECT_FALSE(camera.contains(Vector2d(400.0, 459.5), 20.0));
  EXPECT_FALSE(camera.contains(Vector2d(kNaN, 20.0)));
}

bool mentions(const std::vector<std::string>& problems, const std::string& word) {
  for (const std::string& problem : problems)
    if (problem.find(word) != std::string::npos) return true;
  return false;
}

TEST(CameraIntrinsics, ValidateListsEverythingWrong) {
  CameraIntrinsics c = test::eurocIntrinsics();
  c.width = 0;
  c.height = -3;
  c.intrinsics << kNaN, 0.5, kInfinity, -1.0;
  c.distortion_coeffs << kNaN, 200.0, 0.0, -kInfinity;
  const std::vector<std::string> problems = c.validate();
  EXPECT_EQ(problems.size(), 9u);
  for (const char* word : {"width", "height", "fu", "fv", "pu", "pv", "distortion_coeffs[0]",
                           "distortion_coeffs[1]", "distortion_coeffs[3]"})
    EXPECT_TRUE(mentions(problems, word)) << word;
  EXPECT_FALSE(mentions(problems, "distortion_coeffs[2]"));
  try {
    const CameraModel camera(c);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    for (const std::string& problem : problems)
      EXPECT_NE(std::string(error.what()).find(problem), std::string::npos) << problem;
  }
}

TEST(CameraIntrinsics, EachValueIsChecked) {
  const CameraIntrinsics good = test::eurocIntrinsics();
  const auto expectOneProblem = [](const CameraIntrinsics& c) {
    EXPECT_EQ(c.validate().size(), 1u);
    EXPECT_THROW(CameraModel{c}, std::invalid_argument);
  };
  for (int i = 0; i < 4; ++i) {
    CameraIntrinsics c = good;
    c.intrinsics(i) = kNaN;
    expectOneProblem(c);
    c.intrinsics(i) = -20.0;
    expectOneProblem(c);
    c = good;
    c.distortion_coeffs(i) = kInfinity;
    expectOneProblem(c);
    c = good;
    c.higher_radial_coeffs(i) = kNaN;
    expectOneProblem(c);
  }
  CameraIntrinsics c = test::tumViIntrinsics();
  c.higher_radial_coeffs(0) = 0.1;
  expectOneProblem(c);
  c = good;
  c.width = 20001;
  expectOneProblem(c);
  c = good;
  c.intrinsics(3) = 480.0;  // the principal point below the image
  expectOneProblem(c);
}

}  // namespace
}  // namespace autocal_vio
