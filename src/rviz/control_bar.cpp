#include "autocal_vio/rviz/control_bar.h"

#include <QAction>
#include <QGridLayout>
#include <QLabel>
#include <QLineEdit>
#include <QMenu>
#include <QPushButton>
#include <QToolButton>

namespace autocal_vio {
namespace {

QToolButton* makeMenuButton(const QString& text, QToolButton::ToolButtonPopupMode mode, QWidget* parent) {
  auto* button = new QToolButton(parent);
  button->setText(text);
  button->setToolButtonStyle(Qt::ToolButtonTextOnly);
  button->setPopupMode(mode);
  button->setMenu(new QMenu(button));
  button->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Preferred);
  return button;
}

}  // namespace

ControlBar::ControlBar(QWidget* parent)
    : QWidget(parent),
      freeze_(makeMenuButton("Freeze", QToolButton::MenuButtonPopup, this)),
      release_(new QPushButton("Release", this)),
      reset_(makeMenuButton("Reset", QToolButton::InstantPopup, this)),
      save_(new QPushButton("Save", this)),
      camchain_path_(new QLineEdit(this)),
      answer_(new QLabel(this)) {
  auto* grid = new QGridLayout(this);
  grid->setContentsMargins(2, 2, 2, 2);
  grid->setSpacing(4);
  grid->addWidget(freeze_, 0, 0);
  grid->addWidget(release_, 0, 1);
  grid->addWidget(reset_, 0, 2);
  grid->addWidget(save_, 1, 0);
  grid->addWidget(camchain_path_, 1, 1, 1, 2);
  grid->addWidget(answer_, 2, 0, 1, 3);
  for (int column = 0; column < 3; ++column) grid->setColumnStretch(column, 1);
  makeFreezeMenu();
  makeResetMenu();
  release_->setToolTip("Goes on estimating all parts of the calibration.");
  const QString about_file =
      "Kalibr's camchain-imucam.yaml is written on the machine where the estimator runs, not on this "
      "one. A URDF can be written with it: see Settings.";
  save_->setToolTip(about_file);
  camchain_path_->setToolTip(about_file);
  camchain_path_->setPlaceholderText("file on the estimator's machine");
  answer_->setTextFormat(Qt::PlainText);
  answer_->setTextInteractionFlags(Qt::TextSelectableByMouse);  // it may name a file
  answer_->setWordWrap(true);
  answer_->setMinimumSize(60, answer_->fontMetrics().lineSpacing());
  connect(release_, &QPushButton::clicked, this, &ControlBar::releaseWanted);
  connect(save_, &QPushButton::clicked, this, &ControlBar::saveWanted);
  connect(camchain_path_, &QLineEdit::editingFinished, this, &ControlBar::settingsChanged);
}

void ControlBar::makeFreezeMenu() {
  rotation_ = freeze_->menu()->addAction("rotation");
  translation_ = freeze_->menu()->addAction("translation");
  time_offset_ = freeze_->menu()->addAction("time offset");
  for (QAction* action : {rotation_, translation_, time_offset_}) {
    action->setCheckable(true);
    action->setChecked(true);
    connect(action, &QAction::triggered, this, &ControlBar::settingsChanged);
  }
  freeze_->setToolTip(
      "Holds the parts of the calibration that are ticked in the menu, bit for bit, until released.");
  connect(freeze_, &QToolButton::clicked, this, &ControlBar::freezeWanted);
}

void ControlBar::makeResetMenu() {
  reset_->setToolTip("Starts the estimation anew. The odometry goes on from its last pose.");
  QAction* keep = reset_->menu()->addAction("keep the calibration");
  QAction* nothing = reset_->menu()->addAction("start from nothing");
  connect(keep, &QAction::triggered, this, [this] { Q_EMIT resetWanted(true); });
  connect(nothing, &QAction::triggered, this, [this] { Q_EMIT resetWanted(false); });
}

void ControlBar::setFreezeParts(const FreezeParts& parts) {
  rotation_->setChecked(parts.rotation);
  translation_->setChecked(parts.translation);
  time_offset_->setChecked(parts.time_offset);
}

FreezeParts ControlBar::freezeParts() const {
  return {rotation_->isChecked(), translation_->isChecked(), time_offset_->isChecked()};
}

void ControlBar::setCamchainPath(const QString& path) {
  camchain_path_->setText(path);
}

QString ControlBar::camchainPath() const {
  return camchain_path_->text().trimmed();
}

void ControlBar::setBusy(bool busy) {
  freeze_->setEnabled(!busy);
  release_->setEnabled(!busy);
  reset_->setEnabled(!busy);
  save_->setEnabled(!busy);
}

void ControlBar::showAnswer(const QString& sentence, bool success) {
  answer_->setText(sentence);
  answer_->setToolTip(sentence);
  answer_->setStyleSheet(success ? "color: #1d6b2f;" : "color: #b02020;");
}

QString ControlBar::answerText() const {
  return answer_->text();
}

}  // namespace autocal_vio
