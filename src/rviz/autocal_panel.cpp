#include "autocal_vio/rviz/autocal_panel.h"

#include <autocal_vio/FreezeExtrinsics.h>
#include <autocal_vio/Reset.h>
#include <autocal_vio/SaveCalibration.h>
#include <ros/exceptions.h>

#include <QVBoxLayout>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "autocal_vio/rviz/call_service.h"
#include "autocal_vio/rviz/control_bar.h"
#include "autocal_vio/rviz/convergence_plots.h"
#include "autocal_vio/rviz/settings_form.h"
#include "autocal_vio/rviz/status_view.h"

namespace autocal_vio {
namespace {

constexpr int kPeriod = 200;                // between two looks for what has come [ms]
constexpr qint64 kSilenceMentioned = 2000;  // [ms]

}  // namespace

AutocalPanel::AutocalPanel(QWidget* parent)
    : rviz::Panel(parent),
      status_view_(new StatusView(this)),
      plots_(new ConvergencePlots(&history_, &truth_, this)),
      form_(new SettingsForm(this)),
      controls_(new ControlBar(this)) {
  makeLayout();
  connectButtons();
  applySettings(PanelSettings());
  timer_.setInterval(kPeriod);
  connect(&timer_, &QTimer::timeout, this, [this] { poll(); });
}

// The subscriber's thread ends before anything it could touch.
AutocalPanel::~AutocalPanel() {
  subscriber_.reset();
}

void AutocalPanel::makeLayout() {
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(2, 2, 2, 2);
  column->setSpacing(2);
  column->addWidget(status_view_);
  column->addWidget(plots_, 1);
  column->addWidget(controls_);
  plots_->addTab(form_, "Settings");
}

void AutocalPanel::connectButtons() {
  connect(form_, &SettingsForm::settingsChanged, this, [this] { settingsChanged(); });
  connect(controls_, &ControlBar::settingsChanged, this, [this] { settingsChanged(); });
  connect(plots_, &ConvergencePlots::timeWindowChanged, this, [this] { Q_EMIT configChanged(); });
  connect(plots_, &QTabWidget::currentChanged, this, [this] { Q_EMIT configChanged(); });
  connect(controls_, &ControlBar::freezeWanted, this, [this] {
    const FreezeParts parts = controls_->freezeParts();
    freeze(parts.rotation, parts.translation, parts.time_offset, "freezing");
  });
  connect(controls_, &ControlBar::releaseWanted, this, [this] { freeze(false, false, false, "releasing"); });
  connect(controls_, &ControlBar::resetWanted, this, [this](bool keep_calibration) {
    Reset::Request request;
    request.keep_calibration = keep_calibration;
    call<Reset>("reset", "resetting", request);
  });
  connect(controls_, &ControlBar::saveWanted, this, [this] { saveCalibration(); });
}

void AutocalPanel::onInitialize() {
  initialized_ = true;
  subscribe();
  timer_.start();
}

PanelSettings AutocalPanel::settings() const {
  const FreezeParts parts = controls_->freezeParts();
  PanelSettings settings;
  settings.nodelet = form_->nodelet();
  settings.simulated_rig = form_->simulatedRig();
  settings.camchain_path = controls_->camchainPath();
  settings.urdf_path = form_->urdfPath();
  settings.freeze_rotation = parts.rotation;
  settings.freeze_translation = parts.translation;
  settings.freeze_time_offset = parts.time_offset;
  settings.time_window = plots_->timeWindow();
  settings.page = plots_->currentIndex();
  return settings;
}

void AutocalPanel::applySettings(const PanelSettings& settings) {
  form_->set(settings.nodelet, settings.simulated_rig, settings.urdf_path);
  controls_->setCamchainPath(settings.camchain_path);
  controls_->setFreezeParts(
      {settings.freeze_rotation, settings.freeze_translation, settings.freeze_time_offset});
  plots_->setTimeWindow(settings.time_window);
  plots_->setCurrentIndex(settings.page);
}

void AutocalPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  PanelSettings loaded = settings();
  loadSettings(config, &loaded);
  applySettings(loaded);
  subscribe();
}

void AutocalPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  saveSettings(settings(), config);
}

void AutocalPanel::settingsChanged() {
  subscribe();
  Q_EMIT configChanged();
}

// Another name is another history.
void AutocalPanel::subscribe() {
  if (!initialized_) return;
  const QString nodelet = form_->nodelet(), rig = form_->simulatedRig();
  if (nodelet == subscribed_nodelet_ && rig == subscribed_rig_) return;
  subscribed_nodelet_ = nodelet;
  subscribed_rig_ = rig;
  subscriber_.reset();
  history_.clear();
  truth_.clear();
  since_message_.invalidate();
  name_problem_.clear();
  stale_ = true;
  try {
    subscriber_ = std::make_unique<StatusSubscriber>(nodelet.toStdString(), rig.toStdString());
  } catch (const ros::Exception& error) {
    name_problem_ = error.what();
  }
}

void AutocalPanel::poll() {
  if (subscriber_) take(subscriber_->take());
  if (const std::optional<ServiceAnswer> answer = caller_.takeAnswer()) {
    controls_->showAnswer(QString::fromStdString(answer->message), answer->success);
    controls_->setBusy(false);
  }
  showLife();
  if (stale_ && plots_->isVisible()) refresh();
}

void AutocalPanel::take(StatusBatch batch) {
  for (const TruthStep& step : batch.truth) truth_.add(step);
  for (const TruthBias& bias : batch.true_biases) truth_.addBias(bias.first, bias.stamp, bias.channels);
  if (batch.true_time_offset) truth_.setTimeOffset(*batch.true_time_offset);
  for (StatusSample& sample : batch.samples) history_.add(std::move(sample));
  if (batch.latest) {
    status_view_->showStatus(*batch.latest);
    since_message_.start();
  }
  stale_ =
      stale_ || batch.latest || !batch.truth.empty() || !batch.true_biases.empty() || batch.true_time_offset;
}

void AutocalPanel::refresh() {
  plots_->refresh();
  stale_ = false;
}

// Says when nothing comes, and why.
void AutocalPanel::showLife() {
  const bool published = subscriber_ && subscriber_->hasPublisher();
  if (!since_message_.isValid()) {
    const QString topic = subscribed_nodelet_ + "/calibration_status";
    if (!name_problem_.isEmpty()) {
      status_view_->showNothing(name_problem_);
    } else if (published) {
      status_view_->showNothing("Waiting for the first message on " + topic + ".");
    } else {
      status_view_->showNothing("Nobody publishes " + topic +
                                ": the nodelet is not running, or has another name (see Settings).");
    }
    return;
  }
  const qint64 silence = since_message_.elapsed();
  if (silence < kSilenceMentioned) {
    status_view_->showRemark(QString());
    return;
  }
  const QString remark = published ? "no message for %1 s" : "nobody publishes now; last message %1 s ago";
  status_view_->showRemark(remark.arg(silence / 1000));
}

template <class Service>
void AutocalPanel::call(const QString& name, const QString& what, const typename Service::Request& request) {
  const std::string service = form_->nodelet().toStdString() + "/" + name.toStdString();
  const auto ask = [service, request](CallBreaker* breaker) {
    return callService<Service>(service, request, breaker);
  };
  if (!caller_.start(ask)) return;
  controls_->setBusy(true);
  controls_->showAnswer(what + " ...", true);
}

void AutocalPanel::freeze(bool rotation, bool translation, bool time_offset, const QString& what) {
  FreezeExtrinsics::Request request;
  request.rotation = rotation;
  request.translation = translation;
  request.time_offset = time_offset;
  call<FreezeExtrinsics>("freeze_extrinsics", what, request);
}

void AutocalPanel::saveCalibration() {
  SaveCalibration::Request request;
  request.camchain_path = controls_->camchainPath().toStdString();
  request.urdf_path = form_->urdfPath().toStdString();
  call<SaveCalibration>("save_calibration", "saving", request);
}

}  // namespace autocal_vio

PLUGINLIB_EXPORT_CLASS(autocal_vio::AutocalPanel, rviz::Panel)
