#include "autocal_vio/sim/recorded_trajectory.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace autocal_vio {
namespace {

constexpr int kOrder = 6;
constexpr double kSmoothing = 1e-6;  // weight of the third differences of the control points
constexpr std::size_t kLeastPoses = 8;
using Weights = Eigen::Matrix<double, kOrder, 1>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

// Weights of the six control points of one interval for the value and `derivative` 0, 1, 2 with respect to u
// in [0, 1].
Weights splineWeights(double u, int derivative) {
  static const Eigen::Matrix<double, kOrder, kOrder> kBasis =
      (Eigen::Matrix<double, kOrder, kOrder>() << 1, 26, 66, 26, 1, 0,  //
       -5, -50, 0, 50, 5, 0,                                            //
       10, 20, -60, 20, 10, 0,                                          //
       -10, 20, 0, -20, 10, 0,                                          //
       5, -20, 30, -20, 5, 0,                                           //
       -1, 5, -10, 10, -5, 1)
          .finished() /
      120.0;
  Weights powers = Weights::Zero();
  for (int k = derivative; k < kOrder; ++k) {
    double factor = 1.0;
    for (int i = 0; i < derivative; ++i) factor *= k - i;
    powers(k) = factor * std::pow(u, k - derivative);
  }
  return kBasis.transpose() * powers;
}

// Decimal seconds to nanoseconds without the rounding of a double.
TimeNs parseSeconds(const std::string& text) {
  const std::size_t point = text.find('.');
  const TimeNs whole = std::stoll(text.substr(0, point));
  if (point == std::string::npos || text.find_first_of("eE") != std::string::npos)
    return text.find_first_of("eE.") == std::string::npos ? whole * kNsPerSecond
                                                          : fromSeconds(std::stod(text));
  std::string fraction = text.substr(point + 1, 9);
  fraction.resize(9, '0');
  return whole * kNsPerSecond + std::stoll(fraction);
}

TimedPose parsePose(std::string line) {
  const bool euroc = line.find(',') != std::string::npos;
  std::replace(line.begin(), line.end(), ',', ' ');
  std::istringstream stream(line);
  std::string stamp;
  Eigen::Vector3d p;
  Eigen::Vector4d q;
  stream >> stamp >> p.x() >> p.y() >> p.z() >> q(0) >> q(1) >> q(2) >> q(3);
  if (!stream) throw std::invalid_argument("fewer than 8 numbers");
  if (!p.allFinite() || !q.allFinite() || q.norm() < 1e-3) throw std::invalid_argument("no pose");
  TimedPose pose;
  pose.stamp = euroc ? std::stoll(stamp) : parseSeconds(stamp);
  pose.T_WB = euroc ? Transform(Eigen::Quaterniond(q(0), q(1), q(2), q(3)), p)
                    : Transform(Eigen::Quaterniond(q(3), q(0), q(1), q(2)), p);
  return pose;
}

ImuSample parseImuSample(std::string line) {
  std::replace(line.begin(), line.end(), ',', ' ');
  std::istringstream stream(line);
  ImuSample sample;
  Eigen::Vector3d& w = sample.angular_velocity;
  Eigen::Vector3d& a = sample.acceleration;
  stream >> sample.stamp >> w.x() >> w.y() >> w.z() >> a.x() >> a.y() >> a.z();
  if (!stream) throw std::invalid_argument("fewer than 7 numbers");
  return sample;
}

// Every line that is neither empty nor a comment, parsed.
template <class Parse>
auto readLines(const std::string& path, const char* what, const Parse& parse) {
  std::ifstream file(path);
  if (!file) throw std::invalid_argument("cannot read " + path);
  std::vector<decltype(parse(std::string()))> values;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    try {
      values.push_back(parse(line));
    } catch (const std::exception& problem) {
      throw std::invalid_argument(path + ":" + std::to_string(number) + ": no " + what + " (" +
                                  problem.what() + ")");
    }
  }
  return values;
}

double medianInterval(const std::vector<TimedPose>& poses) {
  std::vector<TimeNs> intervals;
  for (std::size_t i = 1; i < poses.size(); ++i) intervals.push_back(poses[i].stamp - poses[i - 1].stamp);
  std::nth_element(intervals.begin(), intervals.begin() + intervals.size() / 2, intervals.end());
  return toSeconds(intervals[intervals.size() / 2]);
}

}  // namespace

std::vector<TimedPose> readTrajectory(const std::string& path) {
  return readLines(path, "pose", parsePose);
}

std::vector<ImuSample> readImu(const std::string& path) {
  return readLines(path, "IMU sample", parseImuSample);
}

RecordedTrajectory::RecordedTrajectory(const std::vector<TimedPose>& poses, double knot_spacing) {
  if (poses.size() < kLeastPoses)
    throw std::invalid_argument("recorded trajectory: at least 8 poses are needed");
  for (std::size_t i = 1; i < poses.size(); ++i)
    if (poses[i].stamp <= poses[i - 1].stamp)
      throw std::invalid_argument("recorded trajectory: stamps must rise (pose " + std::to_string(i) + ")");
  if (!(knot_spacing > 1e-3 && knot_spacing < 10.0))
    throw std::invalid_argument("recorded trajectory: knot_spacing must be within (0.001, 10) s");
  begin_ = poses.front().stamp;
  end_ = poses.back().stamp;
  spacing_ = std::max(knot_spacing, medianInterval(poses));
  fit(poses);
}

void RecordedTrajectory::fit(const std::vector<TimedPose>& poses) {
  const int intervals = static_cast<int>(std::floor(toSeconds(end_ - begin_) / spacing_)) + 1;
  const int n = intervals + kOrder - 1;
  std::vector<Eigen::Triplet<double>> entries;
  Controls right = Controls::Zero(n, 7);
  Eigen::Vector4d previous = poses.front().T_WB.rotation.coeffs();
  for (const TimedPose& pose : poses) {
    const double x = toSeconds(pose.stamp - begin_) / spacing_;
    const int i = std::min(static_cast<int>(x), intervals - 1);
    const Weights weights = splineWeights(x - i, 0);
    // q and -q are the same rotation; the components must not jump.
    Eigen::Vector4d q = pose.T_WB.rotation.coeffs();
    if (q.dot(previous) < 0.0) q = -q;
    previous = q;
    Vector7d value;
    value << pose.T_WB.translation, q;
    right.middleRows<kOrder>(i) += weights * value.transpose();
    for (int r = 0; r < kOrder; ++r)
      for (int c = 0; c < kOrder; ++c) entries.emplace_back(i + r, i + c, weights(r) * weights(c));
  }
  const double smoothing = kSmoothing * static_cast<double>(poses.size()) / intervals;
  const Eigen::Vector4d difference(-1.0, 3.0, -3.0, 1.0);
  for (int i = 0; i + 4 <= n; ++i)
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c)
        entries.emplace_back(i + r, i + c, smoothing * difference(r) * difference(c));
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
  if (solver.info() != Eigen::Success)
    throw std::invalid_argument("recorded trajectory: the spline cannot be fitted");
  controls_ = solver.solve(right);
}

RigMotion RecordedTrajectory::at(TimeNs stamp) const {
  const double x = toSeconds(std::clamp(stamp, begin_, end_) - begin_) / spacing_;
  const int i = std::min(static_cast<int>(x), static_cast<int>(controls_.rows()) - kOrder);
  const auto local = controls_.middleRows<kOrder>(i);
  const Vector7d value = local.transpose() * splineWeights(x - i, 0);
  const Vector7d first = local.transpose() * splineWeights(x - i, 1) / spacing_;
  const Vector7d second = local.transpose() * splineWeights(x - i, 2) / (spacing_ * spacing_);
  RigMotion motion;
  const Eigen::Quaterniond q(value.tail<4>().eval());
  const Eigen::Quaterniond q_rate(first.tail<4>().eval());
  motion.T_WB = Transform(q, value.head<3>().eval());
  motion.velocity_W = first.head<3>();
  motion.acceleration_W = second.head<3>();
  // R = q / |q|: the part of q' along q drops out of the vector part of q^* q'.
  motion.angular_velocity_B = 2.0 * (q.conjugate() * q_rate).vec() / q.squaredNorm();
  return motion;
}

}  // namespace autocal_vio
