// Angles are radians everywhere but where people read or write them.
#pragma once

namespace autocal_vio {

constexpr double kDegree = 3.14159265358979323846 / 180.0;  ///< [rad]

}  // namespace autocal_vio
