#include "autocal_vio/rviz/convergence_plots.h"

#include <QComboBox>
#include <QGridLayout>
#include <algorithm>
#include <array>

namespace autocal_vio {
namespace {

constexpr std::array<int, 4> kTimeWindows{0, 600, 60, 20};  // [s]
constexpr std::array<const char*, 4> kTimeWindowNames{"all", "10 min", "1 min", "20 s"};
constexpr int kFewestColumns = 100, kMostColumns = 600;

const QColor kRed(200, 50, 47), kGreen(45, 130, 55), kBlue(30, 95, 180), kViolet(130, 60, 150);

PlotSpec single(const QString& title, const QString& unit, Channel channel, int decimals, double least_span,
                const QString& tool_tip) {
  return {title, unit, decimals, least_span, tool_tip, {{channel, QString(), kBlue}}};
}

PlotSpec vector(const QString& title, const QString& unit, Channel first, double least_span,
                const QString& tool_tip) {
  const auto channel = [first](int i) { return static_cast<Channel>(first + i); };
  return {title,    unit,
          3,        least_span,
          tool_tip, {{channel(0), "x", kRed}, {channel(1), "y", kGreen}, {channel(2), "z", kBlue}}};
}

/// Row by row, two a row.
std::vector<PlotSpec> extrinsicsPlots() {
  const QString rotation =
      "Rotation of T_imu_cam = Rz(yaw) Ry(pitch) Rx(roll): camera to IMU coordinates, the inverse of "
      "Kalibr's T_cam_imu. Shaded: 3 sigma. Dashed: the truth, where a simulated rig tells it.";
  const QString position =
      "Position of the camera in the IMU frame (translation of T_imu_cam). Shaded: 3 sigma. "
      "Dashed: the truth, where a simulated rig tells it.";
  return {single("yaw", "°", kYaw, 2, 0.2, rotation),
          single("x", "cm", kPositionX, 2, 0.2, position),
          single("pitch", "°", kPitch, 2, 0.2, rotation),
          single("y", "cm", kPositionY, 2, 0.2, position),
          single("roll", "°", kRoll, 2, 0.2, rotation),
          single("z", "cm", kPositionZ, 2, 0.2, position),
          single("time offset", "ms", kTimeOffset, 2, 0.2,
                 "t_imu = t_cam + time offset. Shaded: 3 sigma. Dashed: the truth, where a simulated rig "
                 "tells it.")};
}

std::vector<PlotSpec> otherPlots() {
  const QString bias =
      "Along the axes of the IMU. Shaded: 3 sigma. Dashed: the truth, where a simulated rig tells it.";
  PlotSpec singular{
      "singular values",
      "",
      3,
      0.1,
      "Of the stacked rotation constraints, Eq. (8): the rotation is determined once s3 is well above s4.",
      {{kSingularValue, "s1", kViolet},
       {static_cast<Channel>(kSingularValue + 1), "s2", kBlue},
       {static_cast<Channel>(kSingularValue + 2), "s3", kGreen},
       {static_cast<Channel>(kSingularValue + 3), "s4", kRed}}};
  return {vector("gyro bias", "°/s", kGyroscopeBias, 0.01, bias),
          vector("accel. bias", "m/s²", kAccelerometerBias, 0.01, bias),
          single("scale", "m", kScale, 4, 0.01,
                 "Metres per unit of the visual structure, until odometry begins. Shaded: 3 sigma."),
          vector("gravity", "m/s²", kGravity, 0.1,
                 "In the frame of the first keyframe's camera, until odometry begins. Shaded: 3 sigma of its "
                 "direction."),
          singular};
}

}  // namespace

ConvergencePlots::ConvergencePlots(const StatusHistory* history, const TruthTrack* truth, QWidget* parent)
    : QTabWidget(parent), history_(history), truth_(truth), time_window_(new QComboBox(this)) {
  addPage("Extrinsics", extrinsicsPlots(), 6);
  addPage("Biases, scale", otherPlots(), 4);
  for (const char* name : kTimeWindowNames) time_window_->addItem(name);
  time_window_->setToolTip("Length of the time axis: the whole history, or the last part of it");
  setCornerWidget(time_window_);
  connect(this, &QTabWidget::currentChanged, this, [this] { refresh(); });
  connect(time_window_, QOverload<int>::of(&QComboBox::currentIndexChanged), this, [this] {
    refresh();
    Q_EMIT timeWindowChanged();
  });
}

// From plot number `wide_from` on, a plot takes both columns.
QWidget* ConvergencePlots::addPage(const QString& name, const std::vector<PlotSpec>& specs, int wide_from) {
  auto* page = new QWidget(this);
  auto* grid = new QGridLayout(page);
  grid->setContentsMargins(2, 2, 2, 2);
  grid->setSpacing(4);
  pages_.emplace_back();
  for (int i = 0; i < static_cast<int>(specs.size()); ++i) {
    pages_.back().push_back(new CalibrationPlot(specs[static_cast<std::size_t>(i)], page));
    const bool wide = i >= wide_from;
    const int row = wide ? wide_from / 2 + i - wide_from : i / 2;
    grid->addWidget(pages_.back().back(), row, wide ? 0 : i % 2, 1, wide ? 2 : 1);
    grid->setRowStretch(row, 1);
  }
  grid->setColumnStretch(0, 1);
  grid->setColumnStretch(1, 1);
  addTab(page, name);
  return page;
}

void ConvergencePlots::refresh() {
  const std::size_t page = static_cast<std::size_t>(std::max(0, currentIndex()));
  if (page >= pages_.size()) return;
  PlotView view;
  view.columns = &columns_;
  view.history = history_;
  view.truth = truth_;
  view.end = history_->end();
  view.begin = history_->begin();
  if (timeWindow() > 0) view.begin = std::max(view.begin, view.end - timeWindow() * kNsPerSecond);
  columns_ = history_->columns(
      view.begin, view.end, static_cast<std::size_t>(std::clamp(width() / 2, kFewestColumns, kMostColumns)));
  for (CalibrationPlot* plot : pages_[page]) plot->show(view);
}

void ConvergencePlots::setTimeWindow(int seconds) {
  const auto nearest = std::min_element(kTimeWindows.begin(), kTimeWindows.end(), [seconds](int a, int b) {
    return std::abs(a - seconds) < std::abs(b - seconds);
  });
  time_window_->setCurrentIndex(static_cast<int>(nearest - kTimeWindows.begin()));
}

int ConvergencePlots::timeWindow() const {
  return kTimeWindows[static_cast<std::size_t>(std::max(0, time_window_->currentIndex()))];
}

}  // namespace autocal_vio
