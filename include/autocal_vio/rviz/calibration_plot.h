// One plot of the panel: curves of one unit with their 3-sigma bands, the truth dashed, the states along its foot.
#pragma once

#include <QColor>
#include <QString>
#include <QWidget>
#include <vector>

#include "autocal_vio/rviz/status_history.h"
#include "autocal_vio/rviz/truth_track.h"

class QwtPlot;
class QwtPlotCurve;

namespace autocal_vio {

class BandedCurve;
class PlotTitle;
class StateStrip;
struct TitlePart;

struct PlotCurve {
  Channel channel = kYaw;
  QString name;  ///< within the plot, such as x; empty where it is the only one
  QColor colour;
};

struct PlotSpec {
  QString title;
  QString unit;
  int decimals = 2;         ///< of the present value
  double least_span = 0.0;  ///< of the value axis
  QString tool_tip;
  std::vector<PlotCurve> curves;
};

/// What is to be seen. Columns and history must outlive the next show(): a plot paints itself again when it is resized.
struct PlotView {
  const std::vector<HistoryBucket>* columns = nullptr;
  const StatusHistory* history = nullptr;
  const TruthTrack* truth = nullptr;
  TimeNs begin = 0, end = 0;  ///< of the time axis, which counts from the beginning of the history
};

class CalibrationPlot : public QWidget {
 public:
  CalibrationPlot(PlotSpec spec, QWidget* parent);

  void show(const PlotView& view);
  const PlotSpec& spec() const { return spec_; }

 private:
  void makeAxes();
  void makeCurves();
  std::vector<TitlePart> titleParts(const StatusSample& latest) const;
  void showTimeAxis(const PlotView& view, TimeNs zero);
  std::vector<double> showTruth(const PlotView& view, TimeNs zero);

  const PlotSpec spec_;
  PlotTitle* title_;
  QwtPlot* plot_;
  // Owned by the plot that they are attached to:
  std::vector<BandedCurve*> curves_;
  std::vector<QwtPlotCurve*> truths_;
  StateStrip* strip_;
};

}  // namespace autocal_vio
