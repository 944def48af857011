// How the panel shows a state: name and colour.
#pragma once

#include <QColor>
#include <QString>
#include <string>

namespace autocal_vio {

struct StateStyle {
  QString name;
  QColor colour;
};

/// For a state of CalibrationStatus; a state that is not known keeps its name and is grey.
StateStyle stateStyle(const std::string& state);

}  // namespace autocal_vio
