// The program asl_to_bag: a data set in ASL format as a bag.
#include <cstdio>
#include <filesystem>

#include "autocal_vio/calibration_io/asl_sensors.h"
#include "autocal_vio/calibration_io/load_problems.h"
#include "autocal_vio/tools/asl_source.h"
#include "autocal_vio/tools/bag_writer.h"
#include "autocal_vio/tools/dataset_reader.h"
#include "autocal_vio/tools/program.h"
#include "autocal_vio/tools/progress_display.h"
#include "autocal_vio/tools/warning_printer.h"

namespace autocal_vio {
namespace {

struct Options {
  std::string folder;
  std::string bag;
  std::string image_topic = "/cam0/image_raw";
  std::string imu_topic = "/imu0";
  DatasetWindow window;
  bool force = false;
  bool quiet = false;
};

CommandLine makeCommandLine(Options* o) {
  CommandLine line(
      "asl_to_bag",
      "Writes the images of cam0, their camera_info and the IMU samples of imu0 of a data set in ASL\n"
      "format (mav0/) to a bag, each at the time of its stamp. The data set's T_BS is not written.");
  line.addText("image-topic", "T", "default: /cam0/image_raw", &o->image_topic);
  line.addText("imu-topic", "T", "default: /imu0", &o->imu_topic);
  line.addNumber("start", "S", "begin S seconds after the first image", &o->window.start);
  line.addNumber("duration", "S", "write S seconds", &o->window.duration);
  line.addFlag("force", "overwrite BAG", &o->force);
  line.addFlag("quiet", "no progress", &o->quiet);
  line.addArgument("FOLDER", "data set with mav0/, or mav0 itself", &o->folder);
  line.addArgument("BAG", "bag to write", &o->bag);
  return line;
}

void convert(const Options& options) {
  if (options.bag.empty()) throw LoadProblems({"FOLDER or BAG is missing (see --help)"});
  const std::optional<std::string> mav0 = findAslFolder(options.folder);
  if (!mav0) throw LoadProblems({options.folder + ": expected a folder with mav0/ (cam0 and imu0) in it"});
  const RigModel rig = loadAslRig(*mav0);
  ProgressDisplay display(stderr, options.quiet ? ProgressDisplay::Style::kSilent
                                                : ProgressDisplay::suitableStyle(stderr, false));
  WarningPrinter warnings("asl_to_bag", &display);
  DatasetReader reader(
      std::make_unique<AslSource>(*mav0, [&warnings](const std::string& text) { warnings.print(text); }),
      options.window);
  BagTopics topics;
  topics.image = options.image_topic;
  topics.imu = options.imu_topic;
  BagWriter bag(options.bag, topics, rig, options.force);
  while (const std::optional<DatasetItem> item = reader.next()) {
    if (const ImuSample* sample = std::get_if<ImuSample>(&*item)) {
      bag.writeImu(sample->stamp, *sample);
    } else {
      const ImageFrame& frame = std::get<ImageFrame>(*item);
      bag.writeImage(frame.stamp, frame);
      display.update(reader.progress(), "");
    }
  }
  bag.close();
  display.finish();
  warnings.finish();
  if (!options.quiet)
    std::fprintf(stderr, "%s: %zu images, %zu IMU samples\n", options.bag.c_str(), reader.imagesRead(),
                 reader.imuRead());
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  autocal_vio::Options options;
  autocal_vio::CommandLine line = autocal_vio::makeCommandLine(&options);
  return autocal_vio::runProgram("asl_to_bag", &line, argc, argv, [&options] {
    autocal_vio::convert(options);
    return 0;
  });
}
