#include "autocal_vio/rviz/settings_form.h"

#include <QFormLayout>
#include <QLabel>
#include <QLineEdit>

namespace autocal_vio {

SettingsForm::SettingsForm(QWidget* parent) : QWidget(parent) {
  new QFormLayout(this);
  nodelet_ = addLine(
      "Nodelet", "Name of the estimator's nodelet or node: its private topics and services are below it.");
  simulated_rig_ =
      addLine("Simulated rig", "Name of a simulated rig, whose truth the plots show dashed; empty: none.");
  urdf_path_ = addLine("URDF to write",
                       "Save also writes robot_description with the calibrated camera joint to this file, on "
                       "the machine where the estimator runs; empty: it does not.");
}

QLineEdit* SettingsForm::addLine(const QString& label, const QString& tool_tip) {
  auto* line = new QLineEdit(this);
  line->setToolTip(tool_tip);
  connect(line, &QLineEdit::editingFinished, this, &SettingsForm::settingsChanged);
  static_cast<QFormLayout*>(layout())->addRow(label, line);
  return line;
}

void SettingsForm::set(const QString& nodelet, const QString& simulated_rig, const QString& urdf_path) {
  nodelet_->setText(nodelet);
  simulated_rig_->setText(simulated_rig);
  urdf_path_->setText(urdf_path);
}

QString SettingsForm::nodelet() const {
  return nodelet_->text().trimmed();
}

QString SettingsForm::simulatedRig() const {
  return simulated_rig_->text().trimmed();
}

QString SettingsForm::urdfPath() const {
  return urdf_path_->text().trimmed();
}

}  // namespace autocal_vio
