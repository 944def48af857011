// The panel's buttons, and what the last of them brought about.
#pragma once

#include <QString>
#include <QWidget>

class QAction;
class QLabel;
class QLineEdit;
class QPushButton;
class QToolButton;

namespace autocal_vio {

struct FreezeParts {
  bool rotation = true;
  bool translation = true;
  bool time_offset = true;
};

class ControlBar : public QWidget {
  Q_OBJECT
 public:
  explicit ControlBar(QWidget* parent);

  void setFreezeParts(const FreezeParts& parts);
  FreezeParts freezeParts() const;
  void setCamchainPath(const QString& path);
  QString camchainPath() const;

  /// While a service is called: the buttons wait.
  void setBusy(bool busy);
  void showAnswer(const QString& sentence, bool success);
  QString answerText() const;

 Q_SIGNALS:
  void freezeWanted();
  void releaseWanted();
  void resetWanted(bool keep_calibration);
  void saveWanted();
  void settingsChanged();

 private:
  void makeFreezeMenu();
  void makeResetMenu();

  QToolButton* freeze_;
  QPushButton* release_;
  QToolButton* reset_;
  QPushButton* save_;
  QLineEdit* camchain_path_;
  QLabel* answer_;
  QAction* rotation_ = nullptr;
  QAction* translation_ = nullptr;
  QAction* time_offset_ = nullptr;
};

}  // namespace autocal_vio
