#include "autocal_vio/camera/camera_model.h"

#include <Eigen/LU>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace autocal_vio {
namespace {

constexpr int kMaxNewtonIterations = 30;
constexpr double kMinDepth = 1e-6;            // [m], below it a point is not in front of the camera
constexpr double kMaxNormalizedRadius = 8.0;  // 83 deg off axis; beyond it x/z is no usable coordinate

// Radial factor and its derivative with respect to r^2 of the radial-tangential model.
struct Radial {
  double factor;
  double derivative;
};

// The factor has no value where its denominator is not positive: NaN.
Radial radialFactor(const CameraIntrinsics& c, double r2) {
  const Eigen::Vector4d &k = c.distortion_coeffs, &h = c.higher_radial_coeffs;
  const double numerator = 1.0 + r2 * (k(0) + r2 * (k(1) + r2 * h(0)));
  const double denominator = 1.0 + r2 * (h(1) + r2 * (h(2) + r2 * h(3)));
  if (!(denominator > 0.0)) return {std::nan(""), std::nan("")};
  const double d_numerator = k(0) + r2 * (2.0 * k(1) + r2 * 3.0 * h(0));
  const double d_denominator = h(1) + r2 * (2.0 * h(2) + r2 * 3.0 * h(3));
  const double factor = numerator / denominator;
  return {factor, (d_numerator - factor * d_denominator) / denominator};
}

bool distortRadialTangential(const CameraIntrinsics& c, const Eigen::Vector2d& m, Eigen::Vector2d* out,
                             Eigen::Matrix2d* J) {
  const double x = m.x(), y = m.y(), r2 = m.squaredNorm();
  const auto [radial, d_radial] = radialFactor(c, r2);
  const double p1 = c.distortion_coeffs(2), p2 = c.distortion_coeffs(3);
  *out << x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
      y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
  if (J) {
    (*J)(0, 0) = radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x;
    (*J)(0, 1) = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y;
    (*J)(1, 0) = (*J)(0, 1);
    (*J)(1, 1) = radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x;
  }
  return true;
}

bool distortEquidistant(const Eigen::Vector4d& k, const Eigen::Vector2d& m, Eigen::Vector2d* out,
                        Eigen::Matrix2d* J) {
  const double r2 = m.squaredNorm(), r = std::sqrt(r2);
  if (r < 1e-8) {
    *out = m;
    if (J) J->setIdentity();
    return true;
  }
  const double theta = std::atan(r), t2 = theta * theta;
  const double polynomial = 1.0 + t2 * (k(0) + t2 * (k(1) + t2 * (k(2) + t2 * k(3))));
  const double theta_d = theta * polynomial;
  const double scale = theta_d / r;
  *out = m * scale;
  if (J) {
    const double d_theta_d =
        1.0 + t2 * (3.0 * k(0) + t2 * (5.0 * k(1) + t2 * (7.0 * k(2) + t2 * 9.0 * k(3))));
    const double d_scale = (d_theta_d / (1.0 + r2) - scale) / r2;  // d scale / d r, divided by r
    *J = scale * Eigen::Matrix2d::Identity() + d_scale * m * m.transpose();
  }
  return true;
}

// Largest radius^2 up to which the distorted radius grows with the true one.
double monotonicRadiusSquared(const CameraIntrinsics& c) {
  constexpr double kStep = 0.01;
  const Eigen::Vector4d& k = c.distortion_coeffs;
  for (double r = kStep; r < kMaxNormalizedRadius; r += kStep) {
    double derivative;
    if (c.distortion_model == DistortionModel::kRadialTangential) {
      const auto [radial, d_radial] = radialFactor(c, r * r);
      derivative = radial + 2.0 * r * r * d_radial;
    } else {
      const double t2 = std::pow(std::atan(r), 2);
      derivative = 1.0 + t2 * (3.0 * k(0) + t2 * (5.0 * k(1) + t2 * (7.0 * k(2) + t2 * 9.0 * k(3))));
    }
    if (!(derivative > 0.0)) return (r - kStep) * (r - kStep);
  }
  return kMaxNormalizedRadius * kMaxNormalizedRadius;
}

}  // namespace

std::vector<std::string> CameraIntrinsics::validate() const {
  std::vector<std::string> problems;
  const auto require = [&](bool good, const std::string& what, double value) {
    if (good) return;
    std::ostringstream text;
    text << what << " (is " << value << ")";
    problems.push_back(text.str());
  };
  require(width > 0 && width <= 20000, "image width must be within (0, 20000] px", width);
  require(height > 0 && height <= 20000, "image height must be within (0, 20000] px", height);
  const char* const focal_names[2] = {"fu", "fv"};
  for (int i = 0; i < 2; ++i)
    require(std::isfinite(intrinsics(i)) && intrinsics(i) > 1.0,
            std::string("focal length ") + focal_names[i] + " must be above 1 px", intrinsics(i));
  require(std::isfinite(intrinsics(2)) && intrinsics(2) > 0.0 && intrinsics(2) < width,
          "principal point pu must lie in the image", intrinsics(2));
  require(std::isfinite(intrinsics(3)) && intrinsics(3) > 0.0 && intrinsics(3) < height,
          "principal point pv must lie in the image", intrinsics(3));
  for (int i = 0; i < 4; ++i)
    require(std::isfinite(distortion_coeffs(i)) && std::abs(distortion_coeffs(i)) < 100.0,
            "distortion_coeffs[" + std::to_string(i) + "] must be finite and below 100 in size",
            distortion_coeffs(i));
  for (int i = 0; i < 4; ++i)
    require(std::isfinite(higher_radial_coeffs(i)) && std::abs(higher_radial_coeffs(i)) < 100.0,
            "radial coefficient k" + std::to_string(3 + i) + " must be finite and below 100 in size",
            higher_radial_coeffs(i));
  if (distortion_model == DistortionModel::kEquidistant)
    require(higher_radial_coeffs.isZero(0.0), "the equidistant model has no higher radial coefficients",
            higher_radial_coeffs.norm());
  require(sigma_principal_point >= 0.0 && sigma_principal_point <= 20.0,
          "sigma_principal_point must be within [0, 20] px", sigma_principal_point);
  require(readout_time >= 0.0 && readout_time <= 0.1, "readout_time must be within [0, 0.1] s", readout_time);
  return problems;
}

CameraModel::CameraModel(const CameraIntrinsics& intrinsics) : intrinsics_(intrinsics) {
  const std::vector<std::string> problems = intrinsics.validate();
  if (!problems.empty()) {
    std::string text = "camera intrinsics:";
    for (const std::string& problem : problems) text += " " + problem + ";";
    throw std::invalid_argument(text);
  }
  max_radius_squared_ = monotonicRadiusSquared(intrinsics_);
}

bool CameraModel::distortNormalized(const Eigen::Vector2d& normalized, Eigen::Vector2d* distorted,
                                    Eigen::Matrix2d* J) const {
  if (!(normalized.squaredNorm() <= max_radius_squared_)) return false;  // false for NaN too
  return intrinsics_.distortion_model == DistortionModel::kRadialTangential
             ? distortRadialTangential(intrinsics_, normalized, distorted, J)
             : distortEquidistant(intrinsics_.distortion_coeffs, normalized, distorted, J);
}

bool CameraModel::distort(const Eigen::Vector2d& normalized, Eigen::Vector2d* pixel,
                          Eigen::Matrix2d* J) const {
  Eigen::Vector2d distorted;
  if (!distortNormalized(normalized, &distorted, J)) return false;
  const Eigen::Vector2d focal = intrinsics_.intrinsics.head<2>();
  *pixel = focal.cwiseProduct(distorted) + intrinsics_.intrinsics.tail<2>();
  if (J) *J = (focal.asDiagonal() * *J).eval();
  return true;
}

bool CameraModel::project(const Eigen::Vector3d& point_C, Eigen::Vector2d* pixel,
                          Eigen::Matrix<double, 2, 3>* J) const {
  if (!(point_C.z() > kMinDepth)) return false;
  const Eigen::Vector2d normalized = point_C.head<2>() / point_C.z();
  Eigen::Matrix2d J_normalized;
  if (!distort(normalized, pixel, J ? &J_normalized : nullptr)) return false;
  if (J) {
    Eigen::Matrix<double, 2, 3> J_perspective;
    J_perspective << 1.0, 0.0, -normalized.x(), 0.0, 1.0, -normalized.y();
    *J = J_normalized * J_perspective / point_C.z();
  }
  return true;
}

std::optional<Eigen::Vector2d> CameraModel::undistort(const Eigen::Vector2d& pixel) const {
  if (!pixel.allFinite()) return std::nullopt;
  const Eigen::Vector2d target =
      (pixel - intrinsics_.intrinsics.tail<2>()).cwiseQuotient(intrinsics_.intrinsics.head<2>());
  Eigen::Vector2d estimate = target;
  const double limit = std::sqrt(max_radius_squared_);
  for (int i = 0; i < kMaxNewtonIterations; ++i) {
    if (estimate.norm() > limit) estimate *= 0.999 * limit / estimate.norm();
    Eigen::Vector2d distorted;
    Eigen::Matrix2d J;
    if (!distortNormalized(estimate, &distorted, &J)) return std::nullopt;
    const Eigen::Vector2d error = target - distorted;
    if (error.squaredNorm() < 1e-26) return estimate;
    if (std::abs(J.determinant()) < 1e-12) return std::nullopt;
    estimate += J.inverse() * error;
  }
  Eigen::Vector2d distorted;
  if (!distortNormalized(estimate, &distorted, nullptr) || (target - distorted).norm() > 1e-9)
    return std::nullopt;
  return estimate;
}

bool CameraModel::contains(const Eigen::Vector2d& pixel, double border) const {
  return pixel.x() >= border && pixel.y() >= border && pixel.x() <= intrinsics_.width - 1 - border &&
         pixel.y() <= intrinsics_.height - 1 - border;
}

}  // namespace autocal_vio
