// How many times the sigmas of white noise are too small, from the estimate's own steps.
//
// The information matrix takes every residual as independent; tracks drift, and it is not. While measurements come
// in, a consistent estimate moves from x1 to x2 with covariance P1 - P2. It moves further when the sigmas lie.
#pragma once

#include <Eigen/Core>

#include "autocal_vio/common/time.h"
#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

class SigmaInflation {
 public:
  /// `least`: factor where the steps agree with the covariances, since they do not see errors that never change.
  explicit SigmaInflation(double least) : least_(least) {}

  /// Adds an estimate of the extrinsics with the covariance [p_BC, theta] that white noise would give.
  void add(TimeNs stamp, const Transform& T_BC, const Eigen::Matrix<double, 6, 6>& covariance);

  /// Factor for sigmas [-], from `least` to four times it.
  double factor() const;

 private:
  struct Sample {
    TimeNs stamp = 0;
    Transform T_BC;
    Eigen::Matrix<double, 6, 1> variance = Eigen::Matrix<double, 6, 1>::Zero();
  };

  double least_;
  bool started_ = false;
  Sample last_;
  double observed_ = 0.0, expected_ = 0.0;  // squares of steps, relative to the variance
};

}  // namespace autocal_vio
