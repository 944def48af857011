// What the panel remembers in the rviz config.
#pragma once

#include <rviz/config.h>

#include <QString>

namespace autocal_vio {

struct PanelSettings {
  QString nodelet = "/vio";                  ///< its private topics and services are below this name
  QString simulated_rig = "/simulated_rig";  ///< whose truth is shown; empty: none
  QString camchain_path = "/tmp/camchain-imucam.yaml";  ///< on the estimator's machine
  QString urdf_path;  ///< on the estimator's machine; empty: none is written
  bool freeze_rotation = true;
  bool freeze_translation = true;
  bool freeze_time_offset = true;
  int time_window = 0;  ///< length of the plots' time axis [s]; 0: all
  int page = 0;         ///< tab of the plots in front
};

/// What the config does not hold stays as it is.
void loadSettings(const rviz::Config& config, PanelSettings* settings);
void saveSettings(const PanelSettings& settings, rviz::Config config);

}  // namespace autocal_vio
