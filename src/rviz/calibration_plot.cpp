#include "autocal_vio/rviz/calibration_plot.h"

#include <qwt_plot.h>
#include <qwt_plot_canvas.h>
#include <qwt_plot_curve.h>
#include <qwt_plot_grid.h>
#include <qwt_plot_layout.h>
#include <qwt_scale_div.h>
#include <qwt_scale_draw.h>
#include <qwt_scale_widget.h>
#include <qwt_text.h>

#include <QVBoxLayout>
#include <cmath>
#include <utility>

#include "autocal_vio/rviz/banded_curve.h"
#include "autocal_vio/rviz/plot_scales.h"
#include "autocal_vio/rviz/plot_title.h"
#include "autocal_vio/rviz/state_strip.h"

namespace autocal_vio {
namespace {

constexpr int kTickPoints = 7;
constexpr int kValueAxisWidth = 46;  // so that plots below each other are aligned [px]
constexpr int kPixelsPerTick = 55;   // on the time axis: room for 1:30:00 h
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
    : QWidget(parent),
      spec_(std::move(spec)),
      title_(new PlotTitle(this)),
      plot_(new QwtPlot(this)),
      strip_(new StateStrip) {
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(title_);
  column->addWidget(plot_, 1);
  setToolTip(spec_.tool_tip);
  makeAxes();
  makeCurves();
  show(PlotView());
}

void CalibrationPlot::makeAxes() {
  plot_->setMinimumSize(110, 50);
  plot_->setCanvasBackground(Qt::white);
  static_cast<QwtPlotCanvas*>(plot_->canvas())->setFrameStyle(QFrame::NoFrame);
  plot_->plotLayout()->setAlignCanvasToScales(true);
  plot_->plotLayout()->setCanvasMargin(0);
  plot_->plotLayout()->setSpacing(1);
  plot_->setAxisScaleDraw(QwtPlot::xBottom, new TimeScaleDraw);
  plot_->setAxisScale(QwtPlot::xBottom, 0.0, kShortest);
  plot_->setAxisScale(QwtPlot::yLeft, -1.0, 1.0);
  plot_->setAxisMaxMajor(QwtPlot::yLeft, 5);
  plot_->setAxisMaxMinor(QwtPlot::yLeft, 0);
  plot_->setAxisMaxMinor(QwtPlot::xBottom, 0);
  plot_->axisScaleDraw(QwtPlot::yLeft)->setMinimumExtent(kValueAxisWidth);
  for (int axis : {static_cast<int>(QwtPlot::xBottom), static_cast<int>(QwtPlot::yLeft)}) {
    plot_->setAxisFont(axis, plainFont(kTickPoints));
    plot_->axisWidget(axis)->setMargin(0);
    plot_->axisWidget(axis)->setSpacing(1);
    plot_->axisScaleDraw(axis)->setTickLength(QwtScaleDiv::MajorTick, 3);
  }
}

void CalibrationPlot::makeCurves() {
  auto* grid = new QwtPlotGrid;
  grid->setZ(0.0);  // behind the curves
  grid->setMajorPen(QColor(228, 228, 228), 0.0);
  grid->attach(plot_);
  for (const PlotCurve& curve : spec_.curves) {
    curves_.push_back(new BandedCurve(curve.channel, curve.colour));
    curves_.back()->setZ(2.0);
    curves_.back()->attach(plot_);
    truths_.push_back(new QwtPlotCurve);
    const QColor colour = spec_.curves.size() > 1 ? curve.colour.darker(160) : QColor(30, 30, 30);
    truths_.back()->setPen(colour, 1.2, Qt::DashLine);
    truths_.back()->setZ(3.0);
    truths_.back()->setItemAttribute(QwtPlotItem::AutoScale, false);
    truths_.back()->attach(plot_);
  }
  strip_->attach(plot_);
}

std::vector<TitlePart> CalibrationPlot::titleParts(const StatusSample& latest) const {
  std::vector<TitlePart> parts{{spec_.title, true, QColor()}};
  const QString unit = spec_.unit.isEmpty() ? QString() : " [" + spec_.unit + "]";
  if (spec_.curves.size() > 1) {
    parts.push_back({unit, false, QColor()});
    for (const PlotCurve& curve : spec_.curves) parts.push_back({"  " + curve.name, true, curve.colour});
    return parts;
  }
  const Measured& now = latest.channels[spec_.curves.front().channel];
  QString text = unit;
  if (std::isfinite(now.value)) {
    text = "  " + QString::number(now.value, 'f', spec_.decimals);
    if (now.sigma > 0.0) text += " ± " + QString::number(3.0 * now.sigma, 'f', spec_.decimals);
    text += " " + spec_.unit;
  }
  parts.push_back({text, false, QColor()});
  return parts;
}

void CalibrationPlot::showTimeAxis(const PlotView& view, TimeNs zero) {
  const double begin = toSeconds(view.begin - zero);
  const double end = std::max(toSeconds(view.end - zero), begin + kShortest);
  const double step = timeTickStep(end - begin, plot_->canvas()->width() / kPixelsPerTick);
  QList<double> ticks;
  for (double tick = step * std::ceil(begin / step - 1e-9); tick <= end; tick += step) ticks << tick;
  plot_->setAxisScaleDiv(QwtPlot::xBottom, QwtScaleDiv(begin, end, QList<double>(), QList<double>(), ticks));
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
  title_->setParts(titleParts(latest));
  if (any) {
    const TimeNs zero = view.history->begin();
    showTimeAxis(view, zero);
    std::vector<Channel> channels;
    for (BandedCurve* curve : curves_) {
      curve->setColumns(view.columns, zero);
      channels.push_back(curve->channel());
    }
    const ScaleRange range = settledRange(*view.columns, channels, showTruth(view, zero), spec_.least_span);
    plot_->setAxisScale(QwtPlot::yLeft, range.low, range.high);
    strip_->setChanges(&view.history->stateChanges(), zero, view.history->end());
  } else {
    for (BandedCurve* curve : curves_) curve->setColumns(nullptr, 0);
    for (QwtPlotCurve* truth : truths_) truth->setSamples(QVector<QPointF>());
    strip_->setChanges(nullptr, 0, 0);
  }
  plot_->replot();
}

}  // namespace autocal_vio
