// A patch that was seen before is found again, deformed, brighter or darker, at the pixel where it belongs.
#include "autocal_vio/frontend/reference_patch.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace autocal_vio {
namespace {

using Eigen::Matrix2f;
using Eigen::Vector2f;

constexpr float kCentre = 60.0F;

// A smooth texture without a grid of its own: its value at any point, so that a deformed image is exact.
double texture(const Vector2f& p) {
  const double x = p.x(), y = p.y();
  return 120.0 + 40.0 * std::sin(0.41 * x + 0.13 * y) + 35.0 * std::sin(0.17 * x - 0.36 * y + 1.0) +
         25.0 * std::sin(0.29 * x + 0.55 * y + 2.0);
}

// The texture about kCentre as seen through x = centre + A (x_reference - kCentre).
cv::Mat view(const Matrix2f& A, const Vector2f& centre, double gain = 1.0, double offset = 0.0) {
  cv::Mat image(120, 120, CV_8UC1);
  const Matrix2f inverse = A.inverse();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Vector2f p = inverse * (Vector2f(static_cast<float>(x), static_cast<float>(y)) - centre);
      image.at<uchar>(y, x) =
          cv::saturate_cast<uchar>(gain * texture(p + Vector2f::Constant(kCentre)) + offset);
    }
  }
  return image;
}

ReferencePatch reference() {
  return *ReferencePatch::cut(view(Matrix2f::Identity(), Vector2f::Constant(kCentre)), {kCentre, kCentre});
}

double errorOf(const std::optional<ReferencePatch::Fit>& fit, const Vector2f& truth) {
  return fit ? std::hypot(fit->pixel.x - truth.x(), fit->pixel.y - truth.y()) : 1e9;
}

Matrix2f turned(float angle, float magnification, float shear) {
  Matrix2f A;
  A << std::cos(angle), -std::sin(angle) + shear, std::sin(angle), std::cos(angle);
  return magnification * A;
}

TEST(ReferencePatch, IsFoundToAHundredthOfAPixel) {
  const Vector2f truth(63.37F, 58.81F);
  const ReferencePatch patch = reference();
  const std::optional<ReferencePatch::Fit> fit = patch.find(
      view(Matrix2f::Identity(), truth), {truth.x() + 0.8F, truth.y() - 0.7F}, Matrix2f::Identity());
  EXPECT_LT(errorOf(fit, truth), 0.01);
  EXPECT_GT(fit->correlation, 0.999F);
}

TEST(ReferencePatch, IsFoundWhenItIsTurnedNearerAndSheared) {
  // From image to image, as a track goes: each fit begins with the deformation of the one before.
  const ReferencePatch patch = reference();
  Matrix2f deformation = Matrix2f::Identity();
  for (int i = 1; i <= 10; ++i) {
    const float t = 0.1F * static_cast<float>(i);
    const Matrix2f A = turned(0.5F * t, 1.0F + 0.5F * t, 0.2F * t);
    const Vector2f truth(kCentre + 3.0F * t, kCentre - 2.0F * t);
    const std::optional<ReferencePatch::Fit> fit =
        patch.find(view(A, truth), {truth.x() + 0.3F, truth.y()}, deformation);
    ASSERT_LT(errorOf(fit, truth), 0.03) << i;
    deformation = fit->deformation;
  }
  const Vector2f singular = turned(0.5F, 1.5F, 0.2F).jacobiSvd().singularValues();
  EXPECT_NEAR(magnificationOf(deformation).x(), singular.x(), 0.02F);
  EXPECT_NEAR(magnificationOf(deformation).y(), singular.y(), 0.02F);
}

TEST(ReferencePatch, BrightnessAndContrastDoNotMatter) {
  const Vector2f truth(60.4F, 59.7F);
  for (const double gain : {0.4, 0.8, 1.1}) {
    const ReferencePatch patch = reference();
    const std::optional<ReferencePatch::Fit> fit =
        patch.find(view(Matrix2f::Identity(), truth, gain, 20.0 - 30.0 * (gain - 0.4)), {kCentre, kCentre},
                   Matrix2f::Identity());
    EXPECT_LT(errorOf(fit, truth), 0.03) << gain;
  }
}

TEST(ReferencePatch, AnythingElseIsRarelyFoundThere) {
  cv::RNG random(3);
  int accepted = 0;
  for (int i = 0; i < 200; ++i) {
    cv::Mat other(120, 120, CV_8UC1);
    random.fill(other, cv::RNG::NORMAL, 120, 60);
    cv::GaussianBlur(other, other, cv::Size(), 2.0);
    const ReferencePatch patch = reference();
    const std::optional<ReferencePatch::Fit> fit =
        patch.find(other, {kCentre, kCentre}, Matrix2f::Identity());
    accepted += fit && fit->correlation > 0.8F && errorOf(fit, Vector2f::Constant(kCentre)) < 1.0;
  }
  EXPECT_LE(accepted, 4);  // smooth blobs, which six parameters can make alike
}

TEST(ReferencePatch, NeedsTextureInBothDirections) {
  const cv::Mat flat(120, 120, CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(ReferencePatch::cut(flat, {kCentre, kCentre}));
  cv::Mat edge = flat.clone();
  edge.colRange(60, 120) = 160;
  EXPECT_FALSE(ReferencePatch::cut(edge, {kCentre, kCentre}));
}

TEST(ReferencePatch, StaysInsideTheImage) {
  const cv::Mat image = view(Matrix2f::Identity(), Vector2f::Constant(kCentre));
  for (const float near : {-5.0F, 0.0F, 3.0F, 7.9F}) {
    EXPECT_FALSE(ReferencePatch::cut(image, {near, kCentre}));
    EXPECT_FALSE(ReferencePatch::cut(image, {kCentre, 119.0F - near}));
    const ReferencePatch patch = reference();
    EXPECT_FALSE(patch.find(image, {near - 2.0F, kCentre}, Matrix2f::Identity()));
    EXPECT_FALSE(patch.find(image, {kCentre, 121.0F - near}, Matrix2f::Identity()));
  }
}

}  // namespace
}  // namespace autocal_vio
