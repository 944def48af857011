#include "autocal_vio/rviz/plot_title.h"

#include <QFontMetrics>
#include <QPainter>
#include <algorithm>
#include <utility>

namespace autocal_vio {
namespace {

constexpr int kPoints = 9;

}  // namespace

PlotTitle::PlotTitle(QWidget* parent) : QWidget(parent) {
  QFont plain = font();
  plain.setPointSize(kPoints);
  setFont(plain);
  setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Fixed);
}

void PlotTitle::setParts(std::vector<TitlePart> parts) {
  parts_ = std::move(parts);
  update();
}

QString PlotTitle::text() const {
  QString all;
  for (const TitlePart& part : parts_) all += part.text;
  return all;
}

QFont PlotTitle::fontOf(const TitlePart& part) const {
  QFont result = font();
  result.setBold(part.bold);
  return result;
}

QSize PlotTitle::sizeHint() const {
  return {100, QFontMetrics(font()).height()};
}

void PlotTitle::paintEvent(QPaintEvent* /*event*/) {
  std::vector<int> widths;
  int total = 0;
  for (const TitlePart& part : parts_) {
    widths.push_back(QFontMetrics(fontOf(part)).horizontalAdvance(part.text));
    total += widths.back();
  }
  QPainter painter(this);
  int x = std::max(0, (width() - total) / 2);
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    painter.setFont(fontOf(parts_[i]));
    painter.setPen(parts_[i].colour.isValid() ? parts_[i].colour : palette().color(QPalette::WindowText));
    painter.drawText(QRect(x, 0, widths[i], height()), Qt::AlignLeft | Qt::AlignVCenter, parts_[i].text);
    x += widths[i];
  }
}

}  // namespace autocal_vio
