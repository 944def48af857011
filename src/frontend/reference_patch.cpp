#include "autocal_vio/frontend/reference_patch.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr int kMaxIterations = 10;
constexpr float kSettled = 0.02F;    // [px] step at which a fit is done
constexpr float kLeastNorm = 15.0F;  // gray levels of the whole patch: flatter is noise
constexpr double kLeastPivot =
    1e-3;  // of the equilibrated normal equations: below it a deformation is not determined
constexpr float kLargestDeformation = 4.0F;

// Bilinear interpolation; the caller sees to it that all four pixels exist.
inline float sample(const cv::Mat& image, float x, float y) {
  const int u = static_cast<int>(x), v = static_cast<int>(y);
  const float a = x - static_cast<float>(u), b = y - static_cast<float>(v);
  const uchar* row = image.ptr<uchar>(v) + u;
  const uchar* next = row + image.step[0];
  const float top = static_cast<float>(row[0]) + a * static_cast<float>(row[1] - row[0]);
  const float bottom = static_cast<float>(next[0]) + a * static_cast<float>(next[1] - next[0]);
  return top + b * (bottom - top);
}

bool inside(const cv::Mat& image, const Eigen::Vector2f& centre, const Eigen::Vector2f& reach) {
  return centre.x() - reach.x() >= 0.0F && centre.y() - reach.y() >= 0.0F &&
         centre.x() + reach.x() < static_cast<float>(image.cols - 1) &&
         centre.y() + reach.y() < static_cast<float>(image.rows - 1);
}

template <class Vector>
float normalize(Vector* values) {
  values->array() -= values->mean();
  const float norm = values->norm();
  if (norm > 0.0F) *values /= norm;
  return norm;
}

}  // namespace

std::optional<ReferencePatch> ReferencePatch::cut(const cv::Mat& image, const cv::Point2f& pixel) {
  if (!inside(image, {pixel.x, pixel.y}, Eigen::Vector2f::Constant(kRadius + 1.0F))) return std::nullopt;
  ReferencePatch patch;
  Eigen::Matrix<double, kPixels, 6> J;
  int i = 0;
  for (int y = -kRadius; y <= kRadius; ++y) {
    for (int x = -kRadius; x <= kRadius; ++x, ++i) {
      const float u = pixel.x + static_cast<float>(x), v = pixel.y + static_cast<float>(y);
      patch.appearance_[i] = sample(image, u, v);
      const double gx = 0.5 * (sample(image, u + 1, v) - sample(image, u - 1, v));
      const double gy = 0.5 * (sample(image, u, v + 1) - sample(image, u, v - 1));
      J.row(i) << gx, gy, gx * x, gx * y, gy * x, gy * y;
    }
  }
  const float norm = normalize(&patch.appearance_);
  if (norm < kLeastNorm) return std::nullopt;
  J /= norm;
  // Gain and offset are solved for as well: what they explain says nothing of the deformation.
  const Eigen::Matrix<double, kPixels, 1> T = patch.appearance_.cast<double>();
  const Eigen::Matrix<double, 1, 6> mean = J.colwise().mean(), gain = T.transpose() * J;
  J.rowwise() -= mean;
  J -= T * gain;
  const Eigen::Matrix<double, 6, 6> H = J.transpose() * J;
  const Eigen::Matrix<double, 6, 1> scale = H.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(scale.asDiagonal() * H * scale.asDiagonal());
  if (solver.vectorD().minCoeff() < kLeastPivot) return std::nullopt;
  patch.response_ = (scale.asDiagonal() * solver.solve(scale.asDiagonal() * J.transpose())).cast<float>();
  return patch;
}

std::optional<ReferencePatch::Fit> ReferencePatch::find(const cv::Mat& image, const cv::Point2f& guess,
                                                        const Eigen::Matrix2f& deformation) const {
  Eigen::Matrix2f A = deformation;
  Eigen::Vector2f centre(guess.x, guess.y);
  Pixels seen;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Eigen::Vector2f reach = A.cwiseAbs().rowwise().sum() * static_cast<float>(kRadius);
    if (!inside(image, centre, reach)) return std::nullopt;
    int i = 0;
    for (int y = -kRadius; y <= kRadius; ++y) {
      const float u = centre.x() + A(0, 1) * static_cast<float>(y),
                  v = centre.y() + A(1, 1) * static_cast<float>(y);
      for (int x = -kRadius; x <= kRadius; ++x, ++i)
        seen[i] = sample(image, u + A(0, 0) * static_cast<float>(x), v + A(1, 0) * static_cast<float>(x));
    }
    if (normalize(&seen) < kLeastNorm) return std::nullopt;
    const Eigen::Matrix<float, 6, 1> step = response_ * (seen - appearance_);
    Eigen::Matrix2f turned = Eigen::Matrix2f::Identity();
    turned.row(0) += step.segment<2>(2).transpose();
    turned.row(1) += step.segment<2>(4).transpose();
    const float determinant = turned.determinant();
    if (!(std::abs(determinant) > 0.1F)) return std::nullopt;
    A = A * turned.inverse();
    const Eigen::Vector2f shift = A * step.head<2>();
    centre -= shift;
    if (!A.allFinite() || !centre.allFinite() || A.norm() > kLargestDeformation) return std::nullopt;
    if (shift.norm() < kSettled) return Fit{{centre.x(), centre.y()}, seen.dot(appearance_), A};
  }
  return std::nullopt;
}

Eigen::Vector2f magnificationOf(const Eigen::Matrix2f& deformation) {
  return Eigen::JacobiSVD<Eigen::Matrix2f>(deformation).singularValues();
}

}  // namespace autocal_vio
