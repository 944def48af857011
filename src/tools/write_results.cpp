#include "autocal_vio/tools/write_results.h"

#include "autocal_vio/tools/result_tables.h"

namespace autocal_vio {
namespace {

KalibrCamchain camchainOf(const RunRecord& record, const Verdict& verdict, const RigModel& rig) {
  KalibrCamchain camchain;
  camchain.camera = *rig.camera;
  camchain.image_topic = rig.image_topic;
  camchain.comment = "Written by autocal_vio. Verdict: " + verdict.name + " (" + verdict.reason + ")";
  if (record.rows().empty() || !extrinsicsKnown(record.rows().back().calibration)) {
    camchain.comment += "\nThe transform between camera and IMU was not estimated and is left out.";
    return camchain;
  }
  const CalibrationEstimate& calibration = record.rows().back().calibration;
  const Eigen::Array<double, 6, 1> sigmas = calibration.covariance.diagonal().array().sqrt();
  camchain.T_imu_cam = calibration.T_imu_cam;
  camchain.td = calibration.td;
  camchain.sigma_translation = sigmas.head<3>().maxCoeff();
  camchain.sigma_rotation = sigmas.tail<3>().maxCoeff();
  camchain.sigma_td = calibration.sigma_td;
  return camchain;
}

}  // namespace

void writeResults(const ResultFolder& folder, const CalibrationRunResult& result, const Verdict& verdict,
                  const RigModel& rig, const PlotTruth& truth) {
  const RunRecord& record = result.record;
  folder.writeText("odometry.tum", odometryTumText(record.rows()));
  folder.writeText("extrinsics.csv", extrinsicsCsvText(record.rows()));
  folder.writeText("report.yaml",
                   runReportText(record, verdict, result.counts, result.timings, truth.T_imu_cam));
  folder.writeCamchain("camchain-imucam.yaml", camchainOf(record, verdict, rig));
  folder.writePng("convergence.png",
                  drawConvergence(record, truth, "Camera-IMU calibration: " + verdict.name));
}

}  // namespace autocal_vio
