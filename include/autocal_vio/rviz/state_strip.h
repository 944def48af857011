// The states over time, as a coloured strip along the foot of a plot, with a line at each change.
#pragma once

#include <qwt_plot_item.h>

#include <deque>

#include "autocal_vio/rviz/status_history.h"

namespace autocal_vio {

class StateStrip : public QwtPlotItem {
 public:
  StateStrip();

  /// The changes must outlive the next draw(). `zero`: the stamp that is 0 on the time axis; `end`: where the last ends.
  void setChanges(const std::deque<HistoryStateChange>* changes, TimeNs zero, TimeNs end);

  void draw(QPainter* painter, const QwtScaleMap& x_map, const QwtScaleMap& y_map,
            const QRectF& canvas) const override;

 private:
  const std::deque<HistoryStateChange>* changes_ = nullptr;
  TimeNs zero_ = 0;
  TimeNs end_ = 0;
};

}  // namespace autocal_vio
