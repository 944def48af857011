#pragma once
namespace autocal_vio {
struct RotationCalibratorOptions {
  double max_sigma_deg = 0.5;
  template <class Visitor>
  void visitFields(Visitor&& visit) {
    visit("max_sigma_deg", max_sigma_deg, 0.01, 20, "R_BC is accepted below this sigma, worst axis [deg]");
  }
};
}  // namespace autocal_vio
