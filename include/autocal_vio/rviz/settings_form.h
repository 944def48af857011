// The settings of the panel that have no place beside a button.
#pragma once

#include <QString>
#include <QWidget>

class QLineEdit;

namespace autocal_vio {

class SettingsForm : public QWidget {
  Q_OBJECT
 public:
  explicit SettingsForm(QWidget* parent);

  void set(const QString& nodelet, const QString& simulated_rig, const QString& urdf_path);
  QString nodelet() const;
  QString simulatedRig() const;
  QString urdfPath() const;

 Q_SIGNALS:
  void settingsChanged();

 private:
  QLineEdit* addLine(const QString& label, const QString& tool_tip);

  QLineEdit* nodelet_;
  QLineEdit* simulated_rig_;
  QLineEdit* urdf_path_;
};

}  // namespace autocal_vio
