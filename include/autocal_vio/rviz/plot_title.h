// One line of text in several colours. (A rich text label would lay itself out anew, slowly, whenever its plot is drawn.)
#pragma once

#include <QColor>
#include <QString>
#include <QWidget>
#include <vector>

namespace autocal_vio {

struct TitlePart {
  QString text;
  bool bold = false;
  QColor colour;  ///< invalid: that of the window's text
};

/// Centred; cut off where it is too narrow.
class PlotTitle : public QWidget {
 public:
  explicit PlotTitle(QWidget* parent);

  void setParts(std::vector<TitlePart> parts);
  QString text() const;

  QSize sizeHint() const override;
  QSize minimumSizeHint() const override { return {20, sizeHint().height()}; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  QFont fontOf(const TitlePart& part) const;

  std::vector<TitlePart> parts_;
};

}  // namespace autocal_vio
