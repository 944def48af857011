// All plots of the panel, on two tabs; only those that are seen are drawn.
#pragma once

#include <QTabWidget>
#include <vector>

#include "autocal_vio/rviz/calibration_plot.h"

class QComboBox;

namespace autocal_vio {

class ConvergencePlots : public QTabWidget {
  Q_OBJECT
 public:
  /// Both must outlive the plots.
  ConvergencePlots(const StatusHistory* history, const TruthTrack* truth, QWidget* parent);

  /// Shows what the history holds now.
  void refresh();

  /// Length of the time axis [s]; 0: the whole history. Of the lengths offered, the nearest.
  void setTimeWindow(int seconds);
  int timeWindow() const;

 Q_SIGNALS:
  void timeWindowChanged();

 private:
  QWidget* addPage(const QString& name, const std::vector<PlotSpec>& specs, int wide_from);

  const StatusHistory* const history_;
  const TruthTrack* const truth_;
  QComboBox* time_window_;
  std::vector<std::vector<CalibrationPlot*>> pages_;
  std::vector<HistoryBucket> columns_;  ///< what the plots paint
};

}  // namespace autocal_vio
