#include "autocal_vio/ros/sensor_messages.h"

#include <cv_bridge/cv_bridge.h>

#include <boost/make_shared.hpp>

#include "autocal_vio/ros/input_conversions.h"

namespace autocal_vio {
namespace {

geometry_msgs::Vector3 toVector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 message;
  message.x = v.x();
  message.y = v.y();
  message.z = v.z();
  return message;
}

}  // namespace

sensor_msgs::ImuPtr toImuMessage(const ImuSample& sample, const ImuNoise& noise, const std::string& frame) {
  const sensor_msgs::ImuPtr message = boost::make_shared<sensor_msgs::Imu>();
  message->header.stamp = toRosTime(sample.stamp);
  message->header.frame_id = frame;
  message->orientation.w = 1.0;
  message->orientation_covariance[0] = -1.0;
  message->angular_velocity = toVector(sample.angular_velocity);
  message->linear_acceleration = toVector(sample.acceleration);
  for (int k = 0; k < 9; k += 4) {
    message->angular_velocity_covariance[k] =
        noise.gyroscope_noise_density * noise.gyroscope_noise_density * noise.update_rate;
    message->linear_acceleration_covariance[k] =
        noise.accelerometer_noise_density * noise.accelerometer_noise_density * noise.update_rate;
  }
  return message;
}

sensor_msgs::ImagePtr toImageMessage(TimeNs stamp, const cv::Mat& image, const std::string& frame) {
  cv_bridge::CvImage bridge;
  bridge.header.stamp = toRosTime(stamp);
  bridge.header.frame_id = frame;
  bridge.encoding = "mono8";
  bridge.image = image;
  return bridge.toImageMsg();
}

sensor_msgs::CameraInfo toCameraInfo(TimeNs stamp, const CameraIntrinsics& intrinsics,
                                     const std::string& frame) {
  sensor_msgs::CameraInfo message;
  message.header.stamp = toRosTime(stamp);
  message.header.frame_id = frame;
  message.width = static_cast<std::uint32_t>(intrinsics.width);
  message.height = static_cast<std::uint32_t>(intrinsics.height);
  const bool fisheye = intrinsics.distortion_model == DistortionModel::kEquidistant;
  const Eigen::Vector4d& higher = intrinsics.higher_radial_coeffs;
  const bool rational = !higher.tail<3>().isZero(0.0);
  message.distortion_model = fisheye ? "equidistant" : rational ? "rational_polynomial" : "plumb_bob";
  for (int k = 0; k < 4; ++k) message.D.push_back(intrinsics.distortion_coeffs(k));
  for (int k = 0; !fisheye && k < (rational ? 4 : 1); ++k) message.D.push_back(higher(k));
  message.K = {intrinsics.intrinsics(0),
               0.0,
               intrinsics.intrinsics(2),
               0.0,
               intrinsics.intrinsics(1),
               intrinsics.intrinsics(3),
               0.0,
               0.0,
               1.0};
  message.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  message.P = {message.K[0], 0.0, message.K[2], 0.0, 0.0, message.K[4],
               message.K[5], 0.0, 0.0,          0.0, 1.0, 0.0};
  return message;
}

geometry_msgs::Vector3Stamped toVectorMessage(TimeNs stamp, const Eigen::Vector3d& vector,
                                              const std::string& frame) {
  geometry_msgs::Vector3Stamped message;
  message.header.stamp = toRosTime(stamp);
  message.header.frame_id = frame;
  message.vector = toVector(vector);
  return message;
}

}  // namespace autocal_vio
