#include "autocal_vio/estimator/standstill_detector.h"

#include <algorithm>
#include <cmath>

#include "autocal_vio/frontend/common_tracks.h"

namespace autocal_vio {
namespace {

constexpr std::size_t kFewestPoints = 8;  // common to two images, or they say nothing
constexpr double kSmallestShare = 0.5;    // of an image's points found again, or they say nothing
constexpr double kReferenceTime = 5.0;    // [s] the reference is no older: tracks wander slowly even at rest
constexpr double kBlockTime = 0.1;  // [s] IMU samples are averaged over it: motion is slow, and noise is not
constexpr int kFewestBlocks = 4;
constexpr double kRateSigmas = 4.0;    // a mean angular rate this far from the bias is a turn
constexpr double kSlowestTurn = 5e-3;  // [rad/s] below it the image decides
constexpr double kLearning = 0.02;     // share of the newest image in what the IMU's noise is at rest

// Means of the IMU's readings [gyroscope, accelerometer] over blocks of time.
using Reading = Eigen::Matrix<double, 6, 1>;
std::vector<Reading> blockMeans(const std::vector<ImuSample>& samples) {
  std::vector<Reading> means;
  Reading sum = Reading::Zero();
  int count = 0;
  TimeNs begin = samples.empty() ? 0 : samples.front().stamp;
  for (const ImuSample& sample : samples) {
    sum.head<3>() += sample.angular_velocity;
    sum.tail<3>() += sample.acceleration;
    ++count;
    if (toSeconds(sample.stamp - begin) < kBlockTime) continue;
    means.push_back(sum / count);
    sum.setZero();
    count = 0;
    begin = sample.stamp;
  }
  return means;
}

}  // namespace

StandstillDetector::Verdict StandstillDetector::compare(const View& before, const View& now,
                                                        double largest_displacement) {
  std::vector<double> displacements;
  forEachCommonTrack(before.points, now.points, [&displacements](const Point& a, const Point& b) {
    displacements.push_back((b.pixel - a.pixel).norm());
  });
  if (displacements.size() < kFewestPoints ||
      static_cast<double>(displacements.size()) < kSmallestShare * static_cast<double>(before.points.size()))
    return Verdict::kUnknown;
  const auto middle = displacements.begin() + static_cast<std::ptrdiff_t>(displacements.size() / 2);
  std::nth_element(displacements.begin(), middle, displacements.end());
  return *middle < largest_displacement ? Verdict::kAtRest : Verdict::kMoving;
}

// White noise leaves block means with a variance of density^2 / block time. Gravity and the accelerometer's bias are in
// all of them alike, so neither has to be known. The noise fitted in motion may be too small, early on above all: once
// the rig stands, what the IMU reads then is noise and nothing else.
bool StandstillDetector::imuAtRest(const StandstillContext& context) {
  const std::vector<Reading> means = blockMeans(context.imu);
  if (static_cast<int>(means.size()) < kFewestBlocks) return false;
  const double count = static_cast<double>(means.size());
  Reading mean = Reading::Zero(), squares = Reading::Zero();
  for (const Reading& m : means) mean += m / count;
  for (const Reading& m : means) squares += (m - mean).cwiseAbs2() / (count - 1.0);
  const double gyro = context.noise.gyroscope_noise_density,
               accel = context.noise.accelerometer_noise_density;
  const Eigen::Array2d variance(squares.head<3>().mean(), squares.tail<3>().mean());
  Eigen::Array2d usual(gyro * gyro / kBlockTime, accel * accel / kBlockTime);
  if (reference_) usual = usual.max(variance_at_rest_);
  if ((variance > criteria_.imu_ratio * criteria_.imu_ratio * usual).any()) return false;
  variance_at_rest_ = reference_ ? (1.0 - kLearning) * variance_at_rest_ + kLearning * variance : variance;
  const double sigma = std::hypot(context.sigma_gyroscope_bias, gyro / std::sqrt(count * kBlockTime));
  return (mean.head<3>() - context.gyroscope_bias).norm() < std::max(kSlowestTurn, kRateSigmas * sigma);
}

bool StandstillDetector::begins(const StandstillContext& context, double largest_displacement) {
  const View &before = recent_.front(), &now = recent_.back();
  if (toSeconds(now.stamp - before.stamp) < criteria_.time) return false;
  // A rig that turns back is where it was, but has not been there in between.
  const auto moving = [&](const View& view) {
    return compare(before, view, largest_displacement) == Verdict::kMoving;
  };
  image_at_rest_ = compare(before, now, largest_displacement) == Verdict::kAtRest &&
                   std::none_of(recent_.begin(), recent_.end(), moving);
  if (!image_at_rest_ || !context.velocity_may_be_zero || !imuAtRest(context)) return false;
  reference_ = before;
  resting_since_ = before.stamp;
  return true;
}

bool StandstillDetector::goesOn(const StandstillContext& context, double largest_displacement) {
  const View &before = recent_.front(), &now = recent_.back();
  const Verdict since_reference = compare(*reference_, now, largest_displacement);
  const Verdict recently = compare(before, now, largest_displacement);
  image_at_rest_ = since_reference == Verdict::kAtRest || recently == Verdict::kAtRest;
  if (since_reference == Verdict::kMoving || recently == Verdict::kMoving || !imuAtRest(context)) {
    recent_.erase(recent_.begin(), recent_.end() - 1);
    reference_.reset();
    image_at_rest_ = false;
    return false;
  }
  if (since_reference == Verdict::kUnknown || toSeconds(now.stamp - reference_->stamp) > kReferenceTime)
    reference_ = before;
  return true;
}

bool StandstillDetector::update(const FeatureFrame& frame, const StandstillContext& context) {
  View view;
  view.stamp = frame.stamp;
  view.points.reserve(frame.features.size());
  for (const Feature& feature : frame.features) view.points.push_back({feature.track_id, feature.pixel});
  recent_.push_back(std::move(view));
  while (recent_.size() > 2 && toSeconds(frame.stamp - recent_[1].stamp) >= criteria_.time)
    recent_.pop_front();
  const double largest_displacement = criteria_.disparity * context.pixel_sigma;
  return reference_ ? goesOn(context, largest_displacement) : begins(context, largest_displacement);
}

}  // namespace autocal_vio
