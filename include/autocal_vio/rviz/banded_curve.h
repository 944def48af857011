// A curve with its 3-sigma band, drawn from the columns of a history.
#pragma once

#include <qwt_plot_item.h>

#include <QColor>
#include <vector>

#include "autocal_vio/rviz/status_history.h"

namespace autocal_vio {

/// Gaps where the channel is not known; the curve's thickness shows all values of a column.
class BandedCurve : public QwtPlotItem {
 public:
  BandedCurve(Channel channel, const QColor& colour);

  Channel channel() const { return channel_; }
  const QColor& colour() const { return colour_; }
  /// Columns, and the stamp that is 0 on the time axis. The columns must outlive the next draw().
  void setColumns(const std::vector<HistoryBucket>* columns, TimeNs zero);

  void draw(QPainter* painter, const QwtScaleMap& x_map, const QwtScaleMap& y_map,
            const QRectF& canvas) const override;

 private:
  struct Column {
    double x, low, high, band_low, band_high;  ///< [px]
  };
  void drawRun(QPainter* painter, const std::vector<Column>& run) const;

  const Channel channel_;
  const QColor colour_;
  const std::vector<HistoryBucket>* columns_ = nullptr;
  TimeNs zero_ = 0;
};

}  // namespace autocal_vio
