// Sensor messages to core values. Everything that comes from outside is checked here.
#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <optional>
#include <string>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/pipeline/vio_system.h"

namespace autocal_vio {

TimeNs toTimeNs(const ros::Time& time);
ros::Time toRosTime(TimeNs stamp);

/// A grey 8-bit copy of an image in mono8, mono16, bgr8, rgb8 or a Bayer encoding. Nothing when the message
/// is unusable; `problem` then names the field.
std::optional<ImageFrame> toImageFrame(const sensor_msgs::ImageConstPtr& message, std::string* problem);

/// Nothing when a value is not finite or the message says that it has none (covariance[0] == -1); `problem`
/// then names the field.
std::optional<ImuSample> toImuSample(const sensor_msgs::Imu& message, std::string* problem);

/// Intrinsics of the images that go with this camera_info: binning and region of interest applied. Nothing
/// when the camera is not calibrated or its lens model cannot be represented; `problem` says why.
std::optional<CameraIntrinsics> toCameraIntrinsics(const sensor_msgs::CameraInfo& message,
                                                   std::string* problem);

/// A frame name without leading slashes.
std::string frameName(const std::string& name);

}  // namespace autocal_vio
