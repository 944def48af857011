// autocal_vio/AutocalPanel: the calibration as it converges, in rviz.
#pragma once

#include <autocal_vio/CalibrationStatus.h>
#include <rviz/panel.h>

#include <QElapsedTimer>
#include <QTimer>
#include <functional>
#include <memory>

#include "autocal_vio/rviz/panel_settings.h"
#include "autocal_vio/rviz/service_caller.h"
#include "autocal_vio/rviz/status_history.h"
#include "autocal_vio/rviz/status_subscriber.h"
#include "autocal_vio/rviz/truth_track.h"

namespace autocal_vio {

class ControlBar;
class ConvergencePlots;
class SettingsForm;
class StatusView;

/// Knows the estimator by its topics and services only, so that either may run on another machine; time is that of the
/// messages' stamps. Messages are received and services called in threads beside the GUI's, which looks a few times a
/// second for what has come, and draws only what is seen.
class AutocalPanel : public rviz::Panel {
  Q_OBJECT
 public:
  explicit AutocalPanel(QWidget* parent = nullptr);
  ~AutocalPanel() override;

  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

  /// What the subscriber hands over, and refresh() by the timer; public so that tests need no ROS.
  void take(StatusBatch batch);
  void refresh();

  const StatusHistory& history() const { return history_; }
  PanelSettings settings() const;

 private:
  void makeLayout();
  void connectButtons();
  void applySettings(const PanelSettings& settings);
  void settingsChanged();
  void subscribe();
  void poll();
  void showLife();
  /// Calls a service below the nodelet's name; `what` is said until it answers.
  template <class Service>
  void call(const QString& name, const QString& what, const typename Service::Request& request);
  void freeze(bool rotation, bool translation, bool time_offset, const QString& what);
  void saveCalibration();

  StatusView* status_view_;
  ConvergencePlots* plots_;
  SettingsForm* form_;
  ControlBar* controls_;
  StatusHistory history_;
  TruthTrack truth_;
  ServiceCaller caller_;
  std::unique_ptr<StatusSubscriber>
      subscriber_;  ///< null before rviz initialises the panel, and where a name is invalid
  QString subscribed_nodelet_, subscribed_rig_;
  QString name_problem_;  ///< why there is no subscriber
  QTimer timer_;
  QElapsedTimer since_message_;  ///< invalid before the first
  bool initialized_ = false;
  bool stale_ = true;  ///< something has come that is not drawn yet
};

}  // namespace autocal_vio
