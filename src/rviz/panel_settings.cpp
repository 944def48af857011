#include "autocal_vio/rviz/panel_settings.h"

namespace autocal_vio {

void loadSettings(const rviz::Config& config, PanelSettings* settings) {
  config.mapGetString("Nodelet", &settings->nodelet);
  config.mapGetString("Simulated Rig", &settings->simulated_rig);
  config.mapGetString("Camchain Path", &settings->camchain_path);
  config.mapGetString("URDF Path", &settings->urdf_path);
  config.mapGetBool("Freeze Rotation", &settings->freeze_rotation);
  config.mapGetBool("Freeze Translation", &settings->freeze_translation);
  config.mapGetBool("Freeze Time Offset", &settings->freeze_time_offset);
  config.mapGetInt("Time Window", &settings->time_window);
  config.mapGetInt("Page", &settings->page);
}

void saveSettings(const PanelSettings& settings, rviz::Config config) {
  config.mapSetValue("Nodelet", settings.nodelet);
  config.mapSetValue("Simulated Rig", settings.simulated_rig);
  config.mapSetValue("Camchain Path", settings.camchain_path);
  config.mapSetValue("URDF Path", settings.urdf_path);
  config.mapSetValue("Freeze Rotation", settings.freeze_rotation);
  config.mapSetValue("Freeze Translation", settings.freeze_translation);
  config.mapSetValue("Freeze Time Offset", settings.freeze_time_offset);
  config.mapSetValue("Time Window", settings.time_window);
  config.mapSetValue("Page", settings.page);
}

}  // namespace autocal_vio
