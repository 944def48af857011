// What is done thousands of times per image takes no memory from the heap.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "autocal_vio/factors/imu_factor.h"
#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/frontend/reference_patch.h"
#include "autocal_vio/graph/frame_state.h"
#include "autocal_vio/imu/preintegration.h"
#include "random_states.h"

#ifdef AUTOCAL_VIO_OPTIMIZED  // sanitizers have an allocator of their own

namespace {
std::atomic<long> allocations{0};
}

// Eigen takes its memory from here, and so does operator new.
extern "C" void* __libc_malloc(std::size_t size);
extern "C" void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}

namespace autocal_vio {
namespace {

long allocationsOf(const std::function<void()>& work) {
  work();  // the first time may set something up
  const long before = allocations;
  for (int i = 0; i < 10; ++i) work();
  return allocations - before;
}

TEST(Allocations, AreCounted) {
  EXPECT_GE(allocationsOf([] { Eigen::VectorXd::Zero(1000).eval(); }), 10);
}

TEST(Allocations, NoneByAnImuFactor) {
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 40; ++i)
    samples.push_back(
        {i * 5000000, Eigen::Vector3d(0.1, 0.2, std::sin(0.1 * i)), Eigen::Vector3d(0.3, 0.1, 9.8)});
  const auto preintegration = std::make_shared<Preintegration>(samples, ImuBias(), ImuNoise());
  const ImuFactor factor(preintegration, Eigen::Vector3d(0.0, 0.0, -9.81));
  test::RandomStates random(1);
  FrameState i, j;
  i.setPose(Transform(random.rotation(), random.vector()));
  j.setPose(Transform(random.rotation(), random.vector()));
  const double* parameters[] = {i.pose.data(), i.motion.data(), j.pose.data(), j.motion.data()};
  double residuals[15], pose_i[15 * 7], motion_i[15 * 9], pose_j[15 * 7], motion_j[15 * 9];
  double* jacobians[] = {pose_i, motion_i, pose_j, motion_j};
  EXPECT_EQ(allocationsOf([&] { factor.Evaluate(parameters, residuals, jacobians); }), 0);
}

TEST(Allocations, NoneByAReprojectionFactor) {
  test::RandomStates random(2);
  ReprojectionMeasurement measurement;
  measurement.normalized = Eigen::Vector2d(0.1, -0.2);
  measurement.sqrt_information = 458.0 * Eigen::Matrix2d::Identity();
  const ReprojectionFactor factor(measurement);
  FrameState frame;
  CalibrationState calibration;
  calibration.setTransform(Transform(random.rotation(), random.vector(0.1)));
  const double landmark[3] = {0.1, -0.2, 0.25};
  const double* parameters[] = {frame.pose.data(), calibration.rotation.data(),
                                calibration.translation.data(), &calibration.td, landmark};
  double residuals[2], pose[14], rotation[8], translation[6], td[2], point[6];
  double* jacobians[] = {pose, rotation, translation, td, point};
  EXPECT_EQ(allocationsOf([&] { factor.Evaluate(parameters, residuals, jacobians); }), 0);
}

TEST(Allocations, NoneByTheFitOfAPatch) {
  cv::Mat image(60, 60, CV_8UC1);
  cv::RNG random(1);
  random.fill(image, cv::RNG::NORMAL, 128, 60);
  cv::GaussianBlur(image, image, cv::Size(), 2.0);
  const std::optional<ReferencePatch> patch = ReferencePatch::cut(image, {30.0F, 30.0F});
  ASSERT_TRUE(patch);
  EXPECT_EQ(allocationsOf([&] {
              EXPECT_TRUE(patch->find(image, {30.6F, 29.7F}, Eigen::Matrix2f::Identity()));
            }),
            0);
}

}  // namespace
}  // namespace autocal_vio

#else

TEST(Allocations, AreCounted) {
  GTEST_SKIP() << "counted in Release builds only";
}

#endif
