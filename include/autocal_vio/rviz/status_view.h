// State with its colour, reason and motion advice of the latest status message.
#pragma once

#include <autocal_vio/CalibrationStatus.h>

#include <QString>
#include <QWidget>

class QLabel;

namespace autocal_vio {

class StatusView : public QWidget {
 public:
  explicit StatusView(QWidget* parent);

  void showStatus(const CalibrationStatus& status);
  /// No message has come: why, in one sentence.
  void showNothing(const QString& why);
  /// Said beside the state: what has stopped, or nothing.
  void showRemark(const QString& remark);

  QString stateText() const;
  QString reasonText() const;
  QString adviceText() const;

 private:
  void showState(const std::string& state);

  QLabel* state_;
  QLabel* remark_;
  QLabel* reason_;
  QLabel* advice_;
};

}  // namespace autocal_vio
