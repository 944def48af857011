#include "autocal_vio/rviz/state_strip.h"

#include <qwt_scale_map.h>

#include <QPainter>
#include <algorithm>

#include "autocal_vio/rviz/state_style.h"

namespace autocal_vio {
namespace {

constexpr double kHeight = 4.0;    // [px]
constexpr int kLineOpacity = 110;  // of 255

}  // namespace

StateStrip::StateStrip() {
  setZ(5.0);
  setItemAttribute(QwtPlotItem::AutoScale, false);
}

void StateStrip::setChanges(const std::deque<HistoryStateChange>* changes, TimeNs zero, TimeNs end) {
  changes_ = changes;
  zero_ = zero;
  end_ = end;
}

void StateStrip::draw(QPainter* painter, const QwtScaleMap& x_map, const QwtScaleMap& /*y_map*/,
                      const QRectF& canvas) const {
  if (!changes_) return;
  for (std::size_t i = 0; i < changes_->size(); ++i) {
    const TimeNs until = i + 1 < changes_->size() ? (*changes_)[i + 1].stamp : end_;
    const double left = x_map.transform(toSeconds((*changes_)[i].stamp - zero_));
    const double right = std::min(x_map.transform(toSeconds(until - zero_)), canvas.right());
    const double shown_left = std::max(left, canvas.left());
    if (right < shown_left) continue;
    QColor colour = stateStyle((*changes_)[i].state).colour;
    painter->fillRect(QRectF(shown_left, canvas.bottom() - kHeight, right - shown_left + 1.0, kHeight),
                      colour);
    if (i == 0 || left < canvas.left()) continue;
    colour.setAlpha(kLineOpacity);
    painter->setPen(QPen(colour, 1.0, Qt::DotLine));
    painter->drawLine(QPointF(left, canvas.top()), QPointF(left, canvas.bottom()));
  }
}

}  // namespace autocal_vio
