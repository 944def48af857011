#include "autocal_vio/rviz/calibration_plot.h"

#include <qwt_plot_canvas.h>
#include <qwt_plot_curve.h>
#include <qwt_plot_grid.h>
#include <qwt_plot_layout.h>
#include <qwt_scale_div.h>
#include <qwt_scale_draw.h>
#include <qwt_scale_widget.h>
#include <qwt_text.h>

#include <cmath>
#include <utility>

#include "autocal_vio/rviz/banded_curve.h"
#include "autocal_vio/rviz/plot_scales.h"
#include "autocal_vio/rviz/state_strip.h"

namespace autocal_vio {
namespace {

constexpr int kTitlePoints = 9, kTickPoints = 7;
constexpr int kValueAxisWidth = 38;  // so that plots below each other are aligned [px]
constexpr int kPixelsPerTick = 55;   // on the time axis
constexpr double kShortest = 5.0;    // that a time axis shows [s]

class TimeScaleDraw : public QwtScaleDraw {
 public:
  QwtText label(double seconds) const override { return QString::fromStdString(timeTickText(seconds)); }
};

QFont plainFont(int points) {
  QFont font;
  font.setPointSize(points);
  font.setBold(false);
  return font;
}

}  // namespace

CalibrationPlot::CalibrationPlot(PlotSpec spec, QWidget* parent)
    : QwtPlot(parent), spec_(std::move(spec)), strip_(new StateStrip) {
  setAutoReplot(false);
  setToolTip(spec_.tool_tip);
  setCanvasBackground(Qt::white);
  static_cast<QwtPlotCanvas*>(canvas())->setFrameStyle(QFrame::NoFrame);
  plotLayout()->setAlignCanvasToScales(true);
  plotLayout()->setCanvasMargin(0);
  plotLayout()->setSpacing(1);
  setAxisScaleDraw(xBottom, new TimeScaleDraw);
  setAxisMaxMajor(yLeft, 4);
  setAxisMaxMinor(yLeft, 0);
  axisScaleDraw(yLeft)->setMinimumExtent(kValueAxisWidth);
  for (int axis : {static_cast<int>(xBottom), static_cast<int>(yLeft)}) {
    setAxisFont(axis, plainFont(kTickPoints));
    axisWidget(axis)->setMargin(0);
    axisWidget(axis)->setSpacing(1);
    axisScaleDraw(axis)->setTickLength(QwtScaleDiv::MajorTick, 3);
  }
  auto* grid = new QwtPlotGrid;
  grid->setMajorPen(QColor(228, 228, 228), 0.0);
  grid->attach(this);
  for (const PlotCurve& curve : spec_.curves) {
    curves_.push_back(new BandedCurve(curve.channel, curve.colour));
    curves_.back()->setZ(2.0);
    curves_.back()->attach(this);
    truths_.push_back(new QwtPlotCurve);
    truths_.back()->setPen(QColor(30, 30, 30), 1.2, Qt::DashLine);
    truths_.back()->setZ(3.0);
    truths_.back()->setItemAttribute(QwtPlotItem::AutoScale, false);
    truths_.back()->attach(this);
  }
  strip_->attach(this);
  setAxisScale(xBottom, 0.0, kShortest);
  setTitle(QString());
  show(PlotView());
}

QString CalibrationPlot::titleText(const StatusSample& latest) const {
  QString text = "<b>" + spec_.title + "</b>";
  if (spec_.curves.size() == 1) {
    const Measured& now = latest.channels[spec_.curves.front().channel];
    if (!std::isfinite(now.value)) return text + (spec_.unit.isEmpty() ? QString() : " [" + spec_.unit + "]");
    text += " " + QString::number(now.value, 'f', spec_.decimals);
    if (now.sigma > 0.0) text += " &plusmn; " + QString::number(3.0 * now.sigma, 'f', spec_.decimals);
    return text + " " + spec_.unit;
  }
  if (!spec_.unit.isEmpty()) text += " [" + spec_.unit + "]";
  for (const PlotCurve& curve : spec_.curves)
    text += " <font color=\"" + curve.colour.name() + "\"><b>" + curve.name + "</b></font>";
  return text;
}

void CalibrationPlot::showTimeAxis(const PlotView& view, TimeNs zero) {
  const double begin = toSeconds(view.begin - zero);
  const double end = std::max(toSeconds(view.end - zero), begin + kShortest);
  const double step = timeTickStep(end - begin, canvas()->width() / kPixelsPerTick);
  QList<double> ticks;
  for (double tick = step * std::ceil(begin / step - 1e-9); tick <= end; tick += step) ticks << tick;
  setAxisScaleDiv(xBottom, QwtScaleDiv(begin, end, QList<double>(), QList<double>(), ticks));
}

// Gives back the values that the value axis must contain.
std::vector<double> CalibrationPlot::showTruth(const PlotView& view, TimeNs zero) {
  std::vector<double> values;
  for (std::size_t i = 0; i < truths_.size(); ++i) {
    const Channel channel = spec_.curves[i].channel;
    QVector<QPointF> points;
    for (const TruthTrack::Point& point :
         view.truth->curve(channel, view.begin, view.end, view.history->latest().channels[channel].value)) {
      points << QPointF(toSeconds(point.stamp - zero), point.value);
      values.push_back(point.value);
    }
    truths_[i]->setSamples(points);
  }
  return values;
}

void CalibrationPlot::show(const PlotView& view) {
  const bool any = view.history && !view.history->empty();
  const StatusSample nothing;
  const StatusSample& latest = any ? view.history->latest() : nothing;
  QwtText title(titleText(latest), QwtText::RichText);
  title.setFont(plainFont(kTitlePoints));
  setTitle(title);
  if (any) {
    const TimeNs zero = view.history->begin();
    showTimeAxis(view, zero);
    std::vector<Channel> channels;
    for (BandedCurve* curve : curves_) {
      curve->setColumns(view.columns, zero);
      channels.push_back(curve->channel());
    }
    const ScaleRange range = settledRange(*view.columns, channels, showTruth(view, zero), spec_.least_span);
    setAxisScale(yLeft, range.low, range.high);
    strip_->setChanges(&view.history->stateChanges(), zero, view.history->end());
  } else {
    for (BandedCurve* curve : curves_) curve->setColumns(nullptr, 0);
    for (QwtPlotCurve* truth : truths_) truth->setSamples(QVector<QPointF>());
    strip_->setChanges(nullptr, 0, 0);
  }
  replot();
}

}  // namespace autocal_vio
