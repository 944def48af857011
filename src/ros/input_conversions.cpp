#include "autocal_vio/ros/input_conversions.h"

#include <cv_bridge/cv_bridge.h>
#include <boost/make_shared.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <utility>

namespace autocal_vio {
namespace {

constexpr std::array<const char*, 12> kEncodings{{"mono8", "mono16", "bgr8", "rgb8", "bayer_rggb8",
                                                  "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8", "bayer_rggb16",
                                                  "bayer_bggr16", "bayer_gbrg16", "bayer_grbg16"}};

constexpr double kDimmest16Bit = 4096.0;  // 16 gray levels of 8 bits

bool isKnownEncoding(const std::string& encoding) {
  for (const char* known : kEncodings) {
    if (encoding == known) return true;
  }
  return false;
}

// cv_bridge turns the bytes of a big-endian message, and then takes them for two channels.
sensor_msgs::ImageConstPtr littleEndian(const sensor_msgs::ImageConstPtr& message) {
  const std::string& encoding = message->encoding;
  if (!message->is_bigendian || encoding.size() < 2 || encoding.compare(encoding.size() - 2, 2, "16") != 0)
    return message;
  const sensor_msgs::ImagePtr turned = boost::make_shared<sensor_msgs::Image>(*message);
  for (std::size_t i = 1; i < turned->data.size(); i += 2) std::swap(turned->data[i - 1], turned->data[i]);
  turned->is_bigendian = 0;
  return turned;
}

// A driver that puts the sensor's 10 or 12 bits into 16 as they are: of its brightest white 8 bits keep next to nothing.
std::string darknessOf(const cv::Mat& image) {
  if (image.depth() != CV_16U) return "";
  double brightest = 0.0;
  cv::minMaxLoc(image.reshape(1), nullptr, &brightest);
  if (brightest >= kDimmest16Bit) return "";
  return "the brightest of its 16-bit values is " + std::to_string(static_cast<int>(brightest)) +
         ", which is black in 8 bits; publish mono8, or shift the values up to 65535";
}

bool isFinite(const geometry_msgs::Vector3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// True where the message says that the images are not distorted: drivers leave D empty or zero then, and the model's
/// name, too.
bool isUndistorted(const sensor_msgs::CameraInfo& message) {
  if (!message.distortion_model.empty() && message.distortion_model != "plumb_bob") return false;
  return std::all_of(message.D.begin(), message.D.end(), [](double value) { return value == 0.0; });
}

/// Distortion coefficients in Kalibr's order; false with the reason where the lens model does not fit.
bool convertDistortion(const sensor_msgs::CameraInfo& message, CameraIntrinsics* intrinsics,
                       std::string* problem) {
  const std::vector<double>& D = message.D;
  const std::string& model = message.distortion_model;
  if (isUndistorted(message)) return true;
  std::size_t largest = 0;  // coefficients of the model that a message may carry
  if (model == "plumb_bob") {
    largest = 5;
  } else if (model == "rational_polynomial") {
    largest = 14;
  } else if (model == "equidistant" || model == "fisheye") {
    largest = 4;
    intrinsics->distortion_model = DistortionModel::kEquidistant;
  } else {
    *problem = "distortion_model '" + model + "' is not known (plumb_bob, rational_polynomial, equidistant)";
    return false;
  }
  if (D.size() < 4 || D.size() > largest) {
    *problem =
        "D has " + std::to_string(D.size()) + " values, " + model + " takes 4 to " + std::to_string(largest);
    return false;
  }
  for (std::size_t i = 8; i < D.size(); ++i) {
    if (D[i] == 0.0) continue;
    *problem =
        "D[" + std::to_string(i) +
        "] is not zero: thin prisms and tilted sensors are not supported, only k1 k2 p1 p2 k3 k4 k5 k6";
    return false;
  }
  for (std::size_t i = 0; i < D.size() && i < 8; ++i)
    (i < 4 ? intrinsics->distortion_coeffs : intrinsics->higher_radial_coeffs)(static_cast<int>(i % 4)) =
        D[i];
  return true;
}

}  // namespace

TimeNs toTimeNs(const ros::Time& time) {
  return static_cast<TimeNs>(time.sec) * kNsPerSecond + time.nsec;
}

ros::Time toRosTime(TimeNs stamp) {
  if (stamp <= 0) return ros::Time();
  return ros::Time(static_cast<std::uint32_t>(stamp / kNsPerSecond),
                   static_cast<std::uint32_t>(stamp % kNsPerSecond));
}

std::optional<ImageFrame> toImageFrame(const sensor_msgs::ImageConstPtr& message, std::string* problem) {
  if (message->header.stamp.isZero()) {
    *problem = "header.stamp is zero";
  } else if (!isKnownEncoding(message->encoding)) {
    *problem = "encoding '" + message->encoding + "' is not supported (mono8, mono16, bgr8, rgb8, bayer)";
  } else if (message->width == 0 || message->height == 0 || message->data.empty()) {
    *problem = "width, height or data is empty";
  } else {
    try {
      const cv_bridge::CvImageConstPtr image = cv_bridge::toCvShare(littleEndian(message));
      *problem = darknessOf(image->image);
      if (problem->empty())
        return ImageFrame{toTimeNs(message->header.stamp), cv_bridge::cvtColor(image, "mono8")->image};
    } catch (const std::exception& error) {
      *problem = std::string("step and data do not fit the encoding: ") + error.what();
    }
  }
  return std::nullopt;
}

std::optional<ImuSample> toImuSample(const sensor_msgs::Imu& message, std::string* problem) {
  if (message.header.stamp.isZero()) {
    *problem = "header.stamp is zero";
  } else if (message.angular_velocity_covariance[0] == -1.0) {
    *problem = "angular_velocity_covariance[0] is -1: the message carries no angular velocity";
  } else if (message.linear_acceleration_covariance[0] == -1.0) {
    *problem = "linear_acceleration_covariance[0] is -1: the message carries no acceleration";
  } else if (!isFinite(message.angular_velocity)) {
    *problem = "angular_velocity is not finite";
  } else if (!isFinite(message.linear_acceleration)) {
    *problem = "linear_acceleration is not finite";
  } else {
    ImuSample sample;
    sample.stamp = toTimeNs(message.header.stamp);
    sample.angular_velocity << message.angular_velocity.x, message.angular_velocity.y,
        message.angular_velocity.z;
    sample.acceleration << message.linear_acceleration.x, message.linear_acceleration.y,
        message.linear_acceleration.z;
    return sample;
  }
  return std::nullopt;
}

std::optional<CameraIntrinsics> toCameraIntrinsics(const sensor_msgs::CameraInfo& message,
                                                   std::string* problem) {
  if (message.K[0] == 0.0) {
    *problem = "K is zero: the camera is not calibrated";
    return std::nullopt;
  }
  if (message.K[1] != 0.0) {
    *problem = "K[1] is not zero: skewed pixels are not supported";
    return std::nullopt;
  }
  CameraIntrinsics intrinsics;
  if (!convertDistortion(message, &intrinsics, problem)) return std::nullopt;
  // K speaks of the full sensor; the images are a region of it, then binned (REP 104). Zero means one, and
  // all.
  const double bin_x = message.binning_x > 0 ? message.binning_x : 1;
  const double bin_y = message.binning_y > 0 ? message.binning_y : 1;
  const bool full = message.roi.width == 0 || message.roi.height == 0;
  const double offset_x = full ? 0.0 : message.roi.x_offset;
  const double offset_y = full ? 0.0 : message.roi.y_offset;
  intrinsics.intrinsics << message.K[0] / bin_x, message.K[4] / bin_y, (message.K[2] - offset_x) / bin_x,
      (message.K[5] - offset_y) / bin_y;
  intrinsics.width = static_cast<int>((full ? message.width : message.roi.width) / bin_x);
  intrinsics.height = static_cast<int>((full ? message.height : message.roi.height) / bin_y);
  const std::vector<std::string> violations = intrinsics.validate();
  if (violations.empty()) return intrinsics;
  problem->clear();
  for (const std::string& violation : violations) *problem += (problem->empty() ? "" : "; ") + violation;
  return std::nullopt;
}

std::string frameName(const std::string& name) {
  const std::size_t first = name.find_first_not_of('/');
  return first == std::string::npos ? "" : name.substr(first);
}

}  // namespace autocal_vio
