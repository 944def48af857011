#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <limits>

#include "autocal_vio/ros/input_conversions.h"
#include "autocal_vio/ros/sensor_messages.h"
#include "autocal_vio/ros/topic_finder.h"

namespace autocal_vio {
namespace {

sensor_msgs::ImagePtr image(const std::string& encoding, int bytes_per_pixel, std::uint8_t value) {
  const sensor_msgs::ImagePtr message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = ros::Time(12, 345);
  message->encoding = encoding;
  message->width = 8;
  message->height = 6;
  message->step = 8 * bytes_per_pixel;
  message->data.assign(message->step * message->height, value);
  return message;
}

TEST(ImageConversion, TakesEveryEncodingOfTheContract) {
  std::string problem;
  for (const char* encoding : {"mono8", "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"}) {
    const std::optional<ImageFrame> frame = toImageFrame(image(encoding, 1, 77), &problem);
    ASSERT_TRUE(frame) << encoding << ": " << problem;
    EXPECT_EQ(frame->stamp, 12 * kNsPerSecond + 345);
    EXPECT_EQ(frame->image.type(), CV_8UC1);
    EXPECT_EQ(frame->image.cols, 8);
    EXPECT_EQ(frame->image.rows, 6);
    EXPECT_NEAR(frame->image.at<std::uint8_t>(3, 4), 77, 1) << encoding;
  }
  for (const char* encoding : {"bgr8", "rgb8"}) {
    const std::optional<ImageFrame> frame = toImageFrame(image(encoding, 3, 50), &problem);
    ASSERT_TRUE(frame) << encoding << ": " << problem;
    EXPECT_NEAR(frame->image.at<std::uint8_t>(3, 4), 50, 1) << encoding;
  }
  const std::optional<ImageFrame> deep = toImageFrame(image("mono16", 2, 0x80), &problem);
  ASSERT_TRUE(deep) << problem;
  EXPECT_NEAR(deep->image.at<std::uint8_t>(3, 4), 128, 1);
}

TEST(ImageConversion, SixteenBitsOfEitherByteOrder) {
  std::string problem;
  const sensor_msgs::ImagePtr message = image("mono16", 2, 0);
  for (std::size_t i = 0; i < message->data.size(); i += 2) message->data[i] = 0x80;
  message->is_bigendian = 1;
  const std::optional<ImageFrame> frame = toImageFrame(message, &problem);
  ASSERT_TRUE(frame) << problem;
  EXPECT_EQ(frame->image.type(), CV_8UC1);
  EXPECT_NEAR(frame->image.at<std::uint8_t>(3, 4), 128, 1);
  // Twelve bits that were not shifted.
  for (std::size_t i = 0; i < message->data.size(); ++i) message->data[i] = i % 2 == 0 ? 0x0f : 0xf0;
  EXPECT_FALSE(toImageFrame(message, &problem));
  EXPECT_NE(problem.find("4080"), std::string::npos) << problem;
}

TEST(ImageConversion, CopiesThePixels) {
  std::string problem;
  const sensor_msgs::ImagePtr message = image("mono8", 1, 10);
  const std::optional<ImageFrame> frame = toImageFrame(message, &problem);
  ASSERT_TRUE(frame);
  message->data.assign(message->data.size(), 99);
  EXPECT_EQ(frame->image.at<std::uint8_t>(0, 0), 10);
}

TEST(ImageConversion, RefusesWithTheFieldNamed) {
  std::string problem;
  EXPECT_FALSE(toImageFrame(image("32FC1", 4, 0), &problem));
  EXPECT_NE(problem.find("32FC1"), std::string::npos) << problem;
  EXPECT_FALSE(toImageFrame(image("", 1, 0), &problem));
  EXPECT_NE(problem.find("encoding"), std::string::npos) << problem;
  sensor_msgs::ImagePtr broken = image("mono8", 1, 0);
  broken->data.resize(7);
  EXPECT_FALSE(toImageFrame(broken, &problem));
  EXPECT_NE(problem.find("data"), std::string::npos) << problem;
  broken = image("mono8", 1, 0);
  broken->step = 2;
  EXPECT_FALSE(toImageFrame(broken, &problem));
  EXPECT_NE(problem.find("step"), std::string::npos) << problem;
  broken = image("mono8", 1, 0);
  broken->width = 0;
  EXPECT_FALSE(toImageFrame(broken, &problem));
  EXPECT_NE(problem.find("width"), std::string::npos) << problem;
  broken = image("mono8", 1, 0);
  broken->header.stamp = ros::Time();
  EXPECT_FALSE(toImageFrame(broken, &problem));
  EXPECT_NE(problem.find("stamp"), std::string::npos) << problem;
}

TEST(ImuConversion, RoundTrip) {
  ImuSample sample;
  sample.stamp = 1403638538577829376;
  sample.angular_velocity << 0.1, -0.2, 0.3;
  sample.acceleration << 1.0, 2.0, 9.0;
  std::string problem;
  const std::optional<ImuSample> back = toImuSample(*toImuMessage(sample, ImuNoise(), "imu"), &problem);
  ASSERT_TRUE(back) << problem;
  EXPECT_EQ(back->stamp, sample.stamp);
  EXPECT_EQ(back->angular_velocity, sample.angular_velocity);
  EXPECT_EQ(back->acceleration, sample.acceleration);
}

TEST(ImuConversion, RefusesWithTheFieldNamed) {
  ImuSample sample;
  sample.stamp = kNsPerSecond;
  const sensor_msgs::Imu good = *toImuMessage(sample, ImuNoise(), "imu");
  std::string problem;
  sensor_msgs::Imu bad = good;
  bad.angular_velocity_covariance[0] = -1.0;
  EXPECT_FALSE(toImuSample(bad, &problem));
  EXPECT_NE(problem.find("angular_velocity_covariance"), std::string::npos) << problem;
  bad = good;
  bad.linear_acceleration_covariance[0] = -1.0;
  EXPECT_FALSE(toImuSample(bad, &problem));
  EXPECT_NE(problem.find("linear_acceleration_covariance"), std::string::npos) << problem;
  bad = good;
  bad.angular_velocity.y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(toImuSample(bad, &problem));
  EXPECT_NE(problem.find("angular_velocity"), std::string::npos) << problem;
  bad = good;
  bad.linear_acceleration.z = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(toImuSample(bad, &problem));
  EXPECT_NE(problem.find("linear_acceleration"), std::string::npos) << problem;
}

CameraIntrinsics eurocCamera(DistortionModel model) {
  CameraIntrinsics intrinsics;
  intrinsics.distortion_model = model;
  intrinsics.intrinsics << 458.654, 457.296, 367.215, 248.375;
  intrinsics.distortion_coeffs << -0.283, 0.074, 0.0002, 0.00002;
  if (model == DistortionModel::kEquidistant) intrinsics.distortion_coeffs << 0.003, 0.001, -0.001, 0.0002;
  intrinsics.width = 752;
  intrinsics.height = 480;
  return intrinsics;
}

TEST(CameraInfoConversion, RoundTripOfBothModels) {
  for (const DistortionModel model : {DistortionModel::kRadialTangential, DistortionModel::kEquidistant}) {
    const CameraIntrinsics intrinsics = eurocCamera(model);
    std::string problem;
    const std::optional<CameraIntrinsics> back =
        toCameraIntrinsics(toCameraInfo(1, intrinsics, "cam"), &problem);
    ASSERT_TRUE(back) << problem;
    EXPECT_EQ(back->distortion_model, model);
    EXPECT_EQ(back->intrinsics, intrinsics.intrinsics);
    EXPECT_EQ(back->distortion_coeffs, intrinsics.distortion_coeffs);
    EXPECT_EQ(back->width, 752);
    EXPECT_EQ(back->height, 480);
  }
}

TEST(CameraInfoConversion, AppliesRegionThenBinning) {
  sensor_msgs::CameraInfo message = toCameraInfo(1, eurocCamera(DistortionModel::kRadialTangential), "cam");
  message.roi.x_offset = 52;
  message.roi.y_offset = 40;
  message.roi.width = 640;
  message.roi.height = 400;
  message.binning_x = 2;
  message.binning_y = 2;
  std::string problem;
  const std::optional<CameraIntrinsics> intrinsics = toCameraIntrinsics(message, &problem);
  ASSERT_TRUE(intrinsics) << problem;
  EXPECT_DOUBLE_EQ(intrinsics->intrinsics(0), 458.654 / 2);
  EXPECT_DOUBLE_EQ(intrinsics->intrinsics(2), (367.215 - 52) / 2);
  EXPECT_DOUBLE_EQ(intrinsics->intrinsics(3), (248.375 - 40) / 2);
  EXPECT_EQ(intrinsics->width, 320);
  EXPECT_EQ(intrinsics->height, 200);
}

TEST(CameraInfoConversion, HigherRadialCoefficients) {
  CameraIntrinsics intrinsics = eurocCamera(DistortionModel::kRadialTangential);
  intrinsics.higher_radial_coeffs << 0.02, 0.0, 0.0, 0.0;
  sensor_msgs::CameraInfo message = toCameraInfo(1, intrinsics, "cam");
  EXPECT_EQ(message.distortion_model, "plumb_bob");
  ASSERT_EQ(message.D.size(), 5u);
  EXPECT_EQ(message.D[4], 0.02);
  std::string problem;
  std::optional<CameraIntrinsics> back = toCameraIntrinsics(message, &problem);
  ASSERT_TRUE(back) << problem;
  EXPECT_EQ(back->higher_radial_coeffs, intrinsics.higher_radial_coeffs);

  intrinsics.higher_radial_coeffs << 0.02, 0.5, -0.1, 0.03;
  message = toCameraInfo(1, intrinsics, "cam");
  EXPECT_EQ(message.distortion_model, "rational_polynomial");
  back = toCameraIntrinsics(message, &problem);
  ASSERT_TRUE(back) << problem;
  EXPECT_EQ(back->distortion_coeffs, intrinsics.distortion_coeffs);
  EXPECT_EQ(back->higher_radial_coeffs, intrinsics.higher_radial_coeffs);
  for (const std::size_t more : {9, 12, 13, 14}) {  // thin prism, tilted sensor
    message.D.resize(more, 0.0);
    EXPECT_TRUE(toCameraIntrinsics(message, &problem)) << problem;
    message.D.back() = 0.01;
    EXPECT_FALSE(toCameraIntrinsics(message, &problem));
    EXPECT_NE(problem.find("D[" + std::to_string(more - 1) + "]"), std::string::npos) << problem;
    message.D.back() = 0.0;
  }
}

TEST(CameraInfoConversion, NoCoefficientsMeanNoDistortion) {
  const sensor_msgs::CameraInfo good =
      toCameraInfo(1, eurocCamera(DistortionModel::kRadialTangential), "cam");
  for (const char* model : {"plumb_bob", ""}) {
    for (const std::size_t size : {0, 4, 5}) {
      sensor_msgs::CameraInfo message = good;
      message.distortion_model = model;
      message.D.assign(size, 0.0);
      std::string problem;
      const std::optional<CameraIntrinsics> intrinsics = toCameraIntrinsics(message, &problem);
      ASSERT_TRUE(intrinsics) << problem;
      EXPECT_EQ(intrinsics->distortion_model, DistortionModel::kRadialTangential);
      EXPECT_EQ(intrinsics->distortion_coeffs, Eigen::Vector4d::Zero());
      EXPECT_EQ(intrinsics->intrinsics(0), 458.654);
    }
  }
  sensor_msgs::CameraInfo unknown = good;
  unknown.distortion_model = "";
  std::string problem;
  EXPECT_FALSE(toCameraIntrinsics(unknown, &problem)) << "coefficients of a model without a name";
  unknown.distortion_model = "equidistant";
  unknown.D.clear();
  EXPECT_FALSE(toCameraIntrinsics(unknown, &problem)) << "no distortion is not the same for a fisheye";
  EXPECT_NE(problem.find("D has 0"), std::string::npos) << problem;
}

TEST(CameraInfoConversion, RefusesWithTheFieldNamed) {
  const sensor_msgs::CameraInfo good =
      toCameraInfo(1, eurocCamera(DistortionModel::kRadialTangential), "cam");
  std::string problem;
  EXPECT_FALSE(toCameraIntrinsics(sensor_msgs::CameraInfo(), &problem));
  EXPECT_NE(problem.find("not calibrated"), std::string::npos) << problem;
  sensor_msgs::CameraInfo bad = good;
  bad.distortion_model = "omni";
  EXPECT_FALSE(toCameraIntrinsics(bad, &problem));
  EXPECT_NE(problem.find("omni"), std::string::npos) << problem;
  bad = good;
  bad.D.resize(2);
  EXPECT_FALSE(toCameraIntrinsics(bad, &problem));
  EXPECT_NE(problem.find("D has 2"), std::string::npos) << problem;
  bad = good;
  bad.D[4] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(toCameraIntrinsics(bad, &problem));
  EXPECT_NE(problem.find("k3"), std::string::npos) << problem;
  bad = good;
  bad.height = 0;
  EXPECT_FALSE(toCameraIntrinsics(bad, &problem));
  EXPECT_FALSE(problem.empty());
}

TEST(Stamps, RoundTrip) {
  for (const TimeNs stamp : {TimeNs{1}, TimeNs{999999999}, TimeNs{1403638538577829376}}) {
    EXPECT_EQ(toTimeNs(toRosTime(stamp)), stamp);
  }
  EXPECT_TRUE(toRosTime(-5).isZero());
}

TEST(FrameName, LosesItsSlashes) {
  EXPECT_EQ(frameName("/cam0"), "cam0");
  EXPECT_EQ(frameName("cam0"), "cam0");
  EXPECT_EQ(frameName("/"), "");
}

TEST(TopicHint, NamesWhatThereIs) {
  const auto hint = [](const std::vector<std::pair<std::string, std::string>>& published) {
    ros::master::V_TopicInfo topics;
    for (const auto& [name, type] : published) topics.emplace_back(name, type);
    return topicHint("/imu", "sensor_msgs/Imu", topics);
  };
  const std::string imu = "sensor_msgs/Imu";
  EXPECT_EQ(hint({}), ": nobody publishes it");
  EXPECT_EQ(hint({{"/right", imu}, {"/left", imu}, {"/wheels", "nav_msgs/Odometry"}}),
            ": nobody publishes it; messages of its type are on /left, /right");
  EXPECT_EQ(hint({{"/e", imu}, {"/d", imu}, {"/c", imu}, {"/b", imu}, {"/a", imu}}),
            ": nobody publishes it; messages of its type are on /a, /b, /c, /d, ...");
  EXPECT_EQ(hint({{"/imu", "nav_msgs/Odometry"}, {"/imu0", imu}}),
            ": what is published there is nav_msgs/Odometry, not sensor_msgs/Imu; messages of its type are "
            "on /imu0");
  EXPECT_EQ(topicHint("/image", "sensor_msgs/Image", {{"/image/compressed", "sensor_msgs/CompressedImage"}}),
            ": nobody publishes it; there is /image/compressed (see ~image_transport)");
}

}  // namespace
}  // namespace autocal_vio
