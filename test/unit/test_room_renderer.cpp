#include "autocal_vio/sim/room_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iostream>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "autocal_vio/geometry/so3.h"
#include "autocal_vio/sim/simulated_rig.h"
#include "autocal_vio/sim/sine_trajectory.h"

namespace autocal_vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

class RoomRendererTest : public ::testing::Test {
 protected:
  // Made once: the textures take a while.
  static void SetUpTestSuite() {
    cv::setNumThreads(1);
    renderer_ = std::make_unique<RoomRenderer>(room_, camera_, 1);
  }
  static void TearDownTestSuite() { renderer_.reset(); }

  Transform cameraPose(double t) const {
    return trajectory_.at(trajectory_.begin() + fromSeconds(t)).T_WB * rig_.T_imu_cam;
  }

  cv::Mat render(const Transform& T_WC) {
    cv::Mat image;
    renderer_->render(T_WC, &image);
    return image;
  }

  // The surface point that a pixel shows, by the independent double-precision path.
  Vector3d surfacePoint(const Transform& T_WC, const Vector2d& pixel) const {
    const Vector2d normalized = *camera_.undistort(pixel);
    const Vector3d ray_W = T_WC.rotation * Vector3d(normalized.x(), normalized.y(), 1.0);
    return T_WC.translation + room_.castRay(T_WC.translation, ray_W) * ray_W;
  }

  bool visible(const Transform& T_WC, const Vector3d& point_W) const {
    return room_.castRay(T_WC.translation, point_W - T_WC.translation) > 0.999;
  }

  static inline const SineTrajectory trajectory_{SineTrajectoryOptions()};
  static inline const SimulatedRig rig_ = randomRig(1);
  static inline const CameraModel camera_{eurocIntrinsics()};
  static inline const Room room_ = Room::around(trajectory_, 1);
  static inline std::unique_ptr<RoomRenderer> renderer_;
};

double threadCpuMs() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

// Mean absolute difference of grays of the same surface points in two images, the second read at an offset
// [px].
double difference(const cv::Mat& a, const cv::Mat& b, const std::vector<std::pair<Vector2d, Vector2d>>& pairs,
                  const Vector2d& offset) {
  cv::Mat x(1, static_cast<int>(pairs.size()), CV_32F), y = x.clone(), sampled;
  for (int i = 0; i < x.cols; ++i) {
    x.at<float>(i) = static_cast<float>(pairs[i].second.x() + offset.x());
    y.at<float>(i) = static_cast<float>(pairs[i].second.y() + offset.y());
  }
  cv::remap(b, sampled, x, y, cv::INTER_LINEAR);
  double sum = 0.0;
  for (int i = 0; i < x.cols; ++i) {
    const Vector2d& p = pairs[i].first;
    sum += std::abs(sampled.at<std::uint8_t>(i) -
                    a.at<std::uint8_t>(static_cast<int>(p.y()), static_cast<int>(p.x())));
  }
  return sum / x.cols;
}

TEST_F(RoomRendererTest, SurfacePointsAppearWhereTheCameraProjectsThem) {
  const Transform T_WC1 = cameraPose(10.0), T_WC2 = cameraPose(10.3);
  const cv::Mat first = render(T_WC1), second = render(T_WC2);
  std::vector<std::pair<Vector2d, Vector2d>> pairs;
  for (int y = 5; y < 475; y += 3) {
    for (int x = 5; x < 747; x += 3) {
      const Vector3d point = surfacePoint(T_WC1, Vector2d(x, y));
      Vector2d pixel;
      if (!visible(T_WC2, point) || !camera_.project(T_WC2.inverse() * point, &pixel)) continue;
      if (camera_.contains(pixel, 3.0)) pairs.emplace_back(Vector2d(x, y), pixel);
    }
  }
  ASSERT_GT(pairs.size(), 5000u);
  const double here = difference(first, second, pairs, Vector2d::Zero());
  for (int axis = 0; axis < 2; ++axis) {
    const Vector2d step = 0.5 * Vector2d::Unit(axis);
    const double before = difference(first, second, pairs, -step),
                 after = difference(first, second, pairs, step);
    EXPECT_LT(here, 0.9 * before);
    EXPECT_LT(here, 0.9 * after);
    // Vertex of the parabola through the three.
    EXPECT_LT(std::abs(0.25 * (before - after) / (before + after - 2.0 * here)), 0.05);
  }
}

TEST_F(RoomRendererTest, TracksFollowTheSurface) {
  std::vector<double> errors;
  for (double t = 5.0; t < 45.0; t += 4.0) {
    const Transform T_WC1 = cameraPose(t), T_WC2 = cameraPose(t + 0.05);
    const cv::Mat first = render(T_WC1), second = render(T_WC2);
    std::vector<cv::Point2f> corners, tracked;
    cv::goodFeaturesToTrack(first, corners, 180, 0.005, 22.0);
    EXPECT_GT(corners.size(), 150u);
    std::vector<std::uint8_t> status;
    std::vector<float> residual;
    cv::calcOpticalFlowPyrLK(first, second, corners, tracked, status, residual, cv::Size(21, 21), 3);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Vector3d point = surfacePoint(T_WC1, Vector2d(corners[i].x, corners[i].y));
      Vector2d pixel;
      if (!visible(T_WC2, point) || !camera_.project(T_WC2.inverse() * point, &pixel)) continue;
      if (!camera_.contains(pixel, 15.0)) continue;
      errors.push_back(status[i] ? (Vector2d(tracked[i].x, tracked[i].y) - pixel).norm() : 1e3);
    }
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GT(errors.size(), 1000u);
  EXPECT_LT(errors[errors.size() / 2], 0.06);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.2);
}

TEST_F(RoomRendererTest, TheSamePoseGivesTheSameImage) {
  RoomRenderer again(room_, camera_, 1), other(room_, camera_, 2);
  const cv::Mat image = render(cameraPose(7.0));
  render(cameraPose(8.0));
  cv::Mat same, different;
  again.render(cameraPose(7.0), &same);
  other.render(cameraPose(7.0), &different);
  EXPECT_EQ(cv::norm(image, same, cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(image, different, cv::NORM_INF), 50.0);
}

TEST_F(RoomRendererTest, ImagesAreWellExposed) {
  for (double t = 2.0; t < 50.0; t += 2.0) {
    cv::Scalar mean, sigma;
    cv::meanStdDev(render(cameraPose(t)), mean, sigma);
    EXPECT_GT(mean[0], 60.0);
    EXPECT_LT(mean[0], 190.0);
    EXPECT_GT(sigma[0], 15.0);
  }
}

// How long a fixed amount of work like the renderer's (floats, integers, scattered reads, none waiting for the
// one before) takes here and now [ms]: what the other hyper-thread and the clock make of the core at the moment.
double yardstickMs() {
  constexpr unsigned kSize = 1U << 20;
  static const std::vector<std::uint8_t> table(kSize, 1);
  const double start = threadCpuMs();
  unsigned sum = 0;
  for (unsigned i = 0; i < 400000; ++i) {
    const float depth = 1.0F / (1.0F + static_cast<float>(i & 1023U));
    const unsigned u = static_cast<unsigned>(1e6F * depth) + 3U * i, v = (i >> 10) * 1024U;
    const unsigned at = (v + u) & (kSize - 2U), below = (at + 1024U) & (kSize - 2U), weight = u & 255U;
    sum += (table[at] * (256U - weight) + table[at + 1U] * weight) * (v & 255U) +
           (table[below] * (256U - weight) + table[below + 1U] * weight) * (256U - (v & 255U));
  }
  EXPECT_GT(sum, 0U);
  return threadCpuMs() - start;
}

// Less than 25 ms on one core of a 2.5 GHz machine that does nothing else, where the yardstick takes 2.4 ms. On a
// slower or a busy core both take longer, hence their ratio; the best of a few rounds counts.
TEST_F(RoomRendererTest, ImagesAreFastToRender) {
#ifdef AUTOCAL_VIO_OPTIMIZED
  constexpr double kLimitMs = 25.0, kYardstickMs = 2.4;
#else
  constexpr double kLimitMs = 1e6, kYardstickMs = 2.4;
#endif
  double best_ms = 1e9, best_ratio = 1e9;
  for (int round = 0; round < 6 && best_ratio * kYardstickMs >= kLimitMs; ++round) {
    std::vector<double> render_ms, yardstick_ms;
    for (double t = 2.0; t < 50.0; t += 2.0) {
      const Transform T_WC = cameraPose(t);
      yardstick_ms.push_back(yardstickMs());
      const double start = threadCpuMs();
      render(T_WC);
      render_ms.push_back(threadCpuMs() - start);
    }
    std::sort(render_ms.begin(), render_ms.end());
    std::sort(yardstick_ms.begin(), yardstick_ms.end());
    const std::size_t middle = render_ms.size() / 2;
    best_ms = std::min(best_ms, render_ms[middle]);
    best_ratio = std::min(best_ratio, render_ms[middle] / yardstick_ms[middle]);
  }
  RecordProperty("render_ms", std::to_string(best_ms));
  std::cout << "rendering 752x480: " << best_ms << " ms of CPU, median; " << best_ratio
            << " times the yardstick\n";
  EXPECT_LT(best_ratio * kYardstickMs, kLimitMs);
}

TEST_F(RoomRendererTest, FisheyeCamerasAreRenderedToo) {
  CameraIntrinsics fisheye = eurocIntrinsics();
  fisheye.distortion_model = DistortionModel::kEquidistant;
  fisheye.intrinsics << 190.98, 190.97, 254.93, 256.9;
  fisheye.distortion_coeffs << 0.0034824, 0.00071503, -0.0020532, 0.00020294;
  fisheye.width = fisheye.height = 512;
  RoomRenderer renderer(room_, CameraModel(fisheye), 1);
  cv::Mat image;
  renderer.render(cameraPose(10.0), &image);
  EXPECT_EQ(image.size(), cv::Size(512, 512));
  EXPECT_GT(cv::mean(image)[0], 40.0);
}

TEST(Room, NothingIsNearTheTrajectory) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SineTrajectoryOptions options;
    options.seed = seed;
    const SineTrajectory trajectory(options);
    const Room room = Room::around(trajectory, seed);
    EXPECT_GE(room.obstacles.size(), 5u);
    for (double t = 0.0; t < 60.0; t += 0.3) {
      const Vector3d p = trajectory.at(trajectory.begin() + fromSeconds(t)).T_WB.translation;
      EXPECT_GT((p - room.walls.min()).minCoeff(), 1.6);
      EXPECT_GT((room.walls.max() - p).minCoeff(), 1.6);
      for (const Eigen::AlignedBox3d& box : room.obstacles) EXPECT_GT(box.exteriorDistance(p), 0.6);
    }
  }
}

}  // namespace
}  // namespace autocal_vio
