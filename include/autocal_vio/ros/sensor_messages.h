// Core values to sensor messages: what drivers of a camera and an IMU would send.
#pragma once

#include <geometry_msgs/Vector3Stamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <opencv2/core/mat.hpp>
#include <string>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/imu/imu_types.h"

namespace autocal_vio {

/// Without orientation; covariances from the white noise at the update rate.
sensor_msgs::ImuPtr toImuMessage(const ImuSample& sample, const ImuNoise& noise, const std::string& frame);

/// `image`: CV_8UC1, sent as mono8.
sensor_msgs::ImagePtr toImageMessage(TimeNs stamp, const cv::Mat& image, const std::string& frame);

/// plumb_bob or equidistant; of the raw image (R identity, P from K).
sensor_msgs::CameraInfo toCameraInfo(TimeNs stamp, const CameraIntrinsics& intrinsics,
                                     const std::string& frame);

/// A bias or another vector in the axes of `frame`.
geometry_msgs::Vector3Stamped toVectorMessage(TimeNs stamp, const Eigen::Vector3d& vector,
                                              const std::string& frame);

}  // namespace autocal_vio
