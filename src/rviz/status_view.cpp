#include "autocal_vio/rviz/status_view.h"

#include <QGridLayout>
#include <QLabel>

#include "autocal_vio/rviz/state_style.h"

namespace autocal_vio {
namespace {

constexpr int kLines = 2;

QLabel* makeLabel(QWidget* parent) {
  auto* label = new QLabel(parent);
  label->setTextFormat(Qt::PlainText);
  label->setTextInteractionFlags(Qt::TextSelectableByMouse);
  return label;
}

/// Wraps, never widens the panel, and keeps its height for short texts.
void makeSentence(QLabel* label, int lines) {
  label->setWordWrap(true);
  label->setAlignment(Qt::AlignTop | Qt::AlignLeft);
  label->setMinimumWidth(60);
  label->setMinimumHeight(lines * label->fontMetrics().lineSpacing());
}

void setTextIfNew(QLabel* label, const QString& text) {
  if (label->text() == text) return;
  label->setText(text);
  label->setToolTip(text);
}

}  // namespace

StatusView::StatusView(QWidget* parent)
    : QWidget(parent),
      state_(makeLabel(this)),
      remark_(makeLabel(this)),
      reason_(makeLabel(this)),
      advice_(makeLabel(this)) {
  auto* grid = new QGridLayout(this);
  grid->setContentsMargins(2, 2, 2, 2);
  grid->setVerticalSpacing(3);
  grid->addWidget(state_, 0, 0);
  grid->addWidget(remark_, 0, 1);
  grid->addWidget(reason_, 1, 0, 1, 2);
  grid->addWidget(advice_, 2, 0, 1, 2);
  grid->setColumnStretch(1, 1);
  makeSentence(reason_, kLines);
  makeSentence(advice_, kLines);
  advice_->setStyleSheet("font-weight: bold; color: #a04000;");
  remark_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);
  remark_->setMinimumWidth(20);
  showState("no status yet");
}

void StatusView::showState(const std::string& state) {
  const StateStyle style = stateStyle(state);
  if (state_->text() == style.name) return;
  state_->setText(style.name);
  state_->setStyleSheet(
      "font-weight: bold; color: white; padding: 2px 8px; border-radius: 3px; background-color: " +
      style.colour.name() + ";");
}

void StatusView::showStatus(const CalibrationStatus& status) {
  showState(status.state);
  setTextIfNew(reason_, QString::fromStdString(status.reason));
  const QString advice = QString::fromStdString(status.motion_advice);
  setTextIfNew(advice_, advice.isEmpty() ? QString() : "Motion that helps: " + advice);
}

void StatusView::showNothing(const QString& why) {
  showState("no status yet");
  setTextIfNew(reason_, why);
  setTextIfNew(advice_, QString());
}

void StatusView::showRemark(const QString& remark) {
  setTextIfNew(remark_, remark);
}

QString StatusView::stateText() const {
  return state_->text();
}

QString StatusView::reasonText() const {
  return reason_->text();
}

QString StatusView::adviceText() const {
  return advice_->text();
}

}  // namespace autocal_vio
