#include "autocal_vio/rviz/banded_curve.h"

#include <qwt_scale_map.h>

#include <QPainter>
#include <QPolygonF>
#include <algorithm>
#include <cmath>

namespace autocal_vio {
namespace {

constexpr int kBandOpacity = 45;       // of 255
constexpr double kFarthest = 20000.0;  // painters misdraw what is very far off [px]

double pixel(const QwtScaleMap& map, double value) {
  return std::clamp(map.transform(value), -kFarthest, kFarthest);
}

}  // namespace

BandedCurve::BandedCurve(Channel channel, const QColor& colour) : channel_(channel), colour_(colour) {
  setRenderHint(QwtPlotItem::RenderAntialiased, true);
  setItemAttribute(QwtPlotItem::AutoScale, false);
}

void BandedCurve::setColumns(const std::vector<HistoryBucket>* columns, TimeNs zero) {
  columns_ = columns;
  zero_ = zero;
}

void BandedCurve::draw(QPainter* painter, const QwtScaleMap& x_map, const QwtScaleMap& y_map,
                       const QRectF& /*canvas*/) const {
  if (!columns_) return;
  std::vector<Column> run;
  for (const HistoryBucket& bucket : *columns_) {
    const ChannelRange& range = bucket.channels[channel_];
    if (!std::isfinite(range.low)) {
      drawRun(painter, run);
      run.clear();
      continue;
    }
    const double x = pixel(x_map, toSeconds((bucket.begin - zero_) / 2 + (bucket.end - zero_) / 2));
    run.push_back({x, pixel(y_map, range.low), pixel(y_map, range.high), pixel(y_map, range.band_low),
                   pixel(y_map, range.band_high)});
  }
  drawRun(painter, run);
}

void BandedCurve::drawRun(QPainter* painter, const std::vector<Column>& run) const {
  if (run.empty()) return;
  QPolygonF band, line;
  band.reserve(static_cast<int>(2 * run.size()));
  line.reserve(static_cast<int>(2 * run.size()));
  for (const Column& column : run) {
    band << QPointF(column.x, column.band_high);
    // The nearer end first: no needless zigzag.
    const bool low_first =
        line.isEmpty() || std::abs(line.back().y() - column.low) < std::abs(line.back().y() - column.high);
    line << QPointF(column.x, low_first ? column.low : column.high);
    if (std::abs(column.high - column.low) > 0.5)
      line << QPointF(column.x, low_first ? column.high : column.low);
  }
  for (auto column = run.rbegin(); column != run.rend(); ++column)
    band << QPointF(column->x, column->band_low);
  QColor shade = colour_;
  shade.setAlpha(kBandOpacity);
  painter->setPen(Qt::NoPen);
  painter->setBrush(shade);
  painter->setRenderHint(QPainter::Antialiasing, false);
  painter->drawPolygon(band);
  painter->setRenderHint(QPainter::Antialiasing, true);
  painter->setBrush(Qt::NoBrush);
  painter->setPen(QPen(colour_, 1.4));
  // Lines one by one are many times quicker than a polyline, whose joints are worked out.
  QVector<QLineF> lines;
  lines.reserve(line.size());
  for (int i = 1; i < line.size(); ++i) lines << QLineF(line[i - 1], line[i]);
  if (lines.isEmpty()) lines << QLineF(line.front(), line.front() + QPointF(1.0, 0.0));
  painter->drawLines(lines);
}

}  // namespace autocal_vio
