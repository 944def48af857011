// The panel without rviz and without ROS: an hour of messages, and its settings. On Qt's offscreen platform, unless
// QT_QPA_PLATFORM names another.
#include <gtest/gtest.h>
#include <rviz/config.h>
#include <rviz/yaml_config_reader.h>
#include <unistd.h>

#include <QApplication>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <functional>
#include <iostream>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "autocal_vio/rviz/autocal_panel.h"
#include "autocal_vio/rviz/convergence_plots.h"
#include "autocal_vio/rviz/service_caller.h"
#include "autocal_vio/rviz/status_view.h"
#include "example_status.h"
#include "process_load.h"

namespace autocal_vio {
namespace {

constexpr std::uint64_t kHour = 72000;  // images at 20 Hz

StatusBatch batchOf(std::uint64_t first, std::uint64_t last) {
  StatusBatch batch;
  for (std::uint64_t image = first; image <= last; ++image) {
    const CalibrationStatus status = exampleStatus(image);
    batch.samples.push_back(toSample(status));
    if (image == last) batch.latest = CalibrationStatus::ConstPtr(new CalibrationStatus(status));
  }
  return batch;
}

/// Draws, and lets Qt paint.
void redraw(AutocalPanel* panel) {
  panel->refresh();
  QApplication::processEvents();
}

class AutocalPanelTest : public testing::Test {
 protected:
  AutocalPanelTest() {
    panel_.resize(620, 900);
    panel_.show();
    QApplication::processEvents();
  }

  ConvergencePlots* plots() { return panel_.findChild<ConvergencePlots*>(); }

  AutocalPanel panel_;
};

TEST_F(AutocalPanelTest, AnHourOfMessagesAtSpeed) {
  StatusBatch truth;
  truth.truth.push_back({fromSeconds(1000.0), {90.0, 0.0, 0.0, 1.0, 2.0, 3.0}});
  truth.true_time_offset = 4.0;
  panel_.take(truth);
  const auto batchWithTruth = [](std::uint64_t first, std::uint64_t last) {
    StatusBatch batch = batchOf(first, last);
    for (const StatusSample& sample : batch.samples) {
      batch.true_biases.push_back({kGyroscopeBias, sample.stamp, {0.57, 0.0, 0.0}});
      batch.true_biases.push_back({kAccelerometerBias, sample.stamp, {0.0, -0.05, 0.0}});
    }
    return batch;
  };
  panel_.take(batchWithTruth(1, 20));
  redraw(&panel_);
  const double memory_before = residentMegabytes();
  std::vector<double> times;
  constexpr std::uint64_t kStep = 100;
  for (std::uint64_t image = 21; image <= kHour; image += kStep) {
    panel_.take(batchWithTruth(image, std::min(kHour, image + kStep - 1)));
    plots()->setCurrentIndex(static_cast<int>(image / kStep / 10 % 2));  // each tab ten times running
    QApplication::processEvents();
    const double start = cpuMilliseconds();
    redraw(&panel_);
    times.push_back(cpuMilliseconds() - start);
  }
  const double growth = residentMegabytes() - memory_before;
  const RedrawTimes redraws(times);
  std::printf("memory grew by %.1f MB to %.0f MB\n", growth, memory_before + growth);
  EXPECT_EQ(panel_.history().end() - panel_.history().begin(), fromSeconds(0.05 * (kHour - 1)));
#ifdef AUTOCAL_VIO_OPTIMIZED  // the address sanitizer keeps what has been freed
  EXPECT_LT(growth, 25.0) << "100 MB may be; a history that keeps all samples takes 50";
  EXPECT_LT(redraws.median, 20.0);
  EXPECT_LT(redraws.nearly_all, 20.0);
#endif
}

TEST_F(AutocalPanelTest, ShowsStateReasonAndAdvice) {
  StatusView* view = panel_.findChild<StatusView*>();
  ASSERT_NE(view, nullptr);
  panel_.take(batchOf(1, 10));
  EXPECT_EQ(view->stateText(), "calibrating rotation");
  EXPECT_EQ(view->reasonText(), "the image was processed");
  EXPECT_TRUE(view->adviceText().contains("rotate about the camera's x axis"));
  panel_.take(batchOf(11, 500));
  EXPECT_EQ(view->stateText(), "converged");
  EXPECT_TRUE(view->adviceText().isEmpty());
}

// A curve is where it belongs: with a value in the middle of the axis, blue pixels there; none before there is data.
TEST_F(AutocalPanelTest, CurvesAreDrawn) {
  const auto bluePixels = [this] {
    const QImage image = plots()->grab().toImage();
    int count = 0;
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        const QColor colour = image.pixelColor(x, y);
        count += colour.blue() > 150 && colour.red() < 80 && colour.green() < 140;
      }
    }
    return count;
  };
  redraw(&panel_);
  EXPECT_LT(bluePixels(), 20);
  panel_.take(batchOf(1, 600));
  redraw(&panel_);
  EXPECT_GT(bluePixels(), 7 * 100) << "seven curves";
}

TEST_F(AutocalPanelTest, ConfigSurvivesSaveAndLoad) {
  rviz::Config changed;
  const PanelSettings expected{"/robot/vio", "", "/data/camchain.yaml", "/data/robot.urdf", true, false, true,
                               60,           1};
  saveSettings(expected, changed);
  panel_.load(changed);
  rviz::Config saved;
  panel_.save(saved);
  AutocalPanel other;
  other.load(saved);
  const PanelSettings settings = other.settings();
  EXPECT_EQ(settings.nodelet, expected.nodelet);
  EXPECT_EQ(settings.simulated_rig, expected.simulated_rig);
  EXPECT_EQ(settings.camchain_path, expected.camchain_path);
  EXPECT_EQ(settings.urdf_path, expected.urdf_path);
  EXPECT_EQ(settings.freeze_rotation, expected.freeze_rotation);
  EXPECT_EQ(settings.freeze_translation, expected.freeze_translation);
  EXPECT_EQ(settings.freeze_time_offset, expected.freeze_time_offset);
  EXPECT_EQ(settings.time_window, expected.time_window);
  EXPECT_EQ(settings.page, expected.page);
  // An empty config, such as that of a panel just added, changes nothing.
  other.load(rviz::Config());
  EXPECT_EQ(other.settings().nodelet, expected.nodelet);
}

/// How many displays of the project's rviz config show a frame's axes, and how many its name.
std::pair<int, int> shownTimes(const QString& frame) {
  rviz::Config config;
  rviz::YamlConfigReader reader;
  reader.readFile(config, "rviz/autocal_vio.rviz");
  const rviz::Config displays = config.mapGetChild("Visualization Manager").mapGetChild("Displays");
  int axes = 0, names = 0;
  for (int i = 0; i < displays.listLength(); ++i) {
    const rviz::Config display = displays.listChildAt(i);
    QString type;
    if (!display.mapGetString("Class", &type) || type != "rviz/TF") continue;
    bool shown = true, named = false;
    display.mapGetChild("Frames").mapGetChild(frame).mapGetBool("Value", &shown);
    display.mapGetBool("Show Names", &named);
    axes += shown;
    names += shown && named;
  }
  return {axes, names};
}

// Camera and IMU are so near each other that their names would be printed over each other.
TEST(RvizConfig, NamesOneOfTwoNeighbours) {
  EXPECT_EQ(shownTimes("odom"), std::make_pair(1, 1));
  EXPECT_EQ(shownTimes("imu0"), std::make_pair(1, 1));
  EXPECT_EQ(shownTimes("cam0"), std::make_pair(1, 0));
}

/// What comes within ten seconds.
std::optional<ServiceAnswer> awaitAnswer(ServiceCaller* caller) {
  std::optional<ServiceAnswer> answer;
  for (int i = 0; i < 1000 && !answer; ++i) {
    usleep(10000);
    answer = caller->takeAnswer();
  }
  return answer;
}

double secondsToEnd(std::function<ServiceAnswer(CallBreaker*)> call) {
  auto caller = std::make_unique<ServiceCaller>();
  EXPECT_TRUE(caller->start(std::move(call)));
  const auto begin = std::chrono::steady_clock::now();
  caller.reset();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

TEST(ServiceCaller, EndsWithItsCallButDoesNotWaitForEver) {
  const auto done = std::make_shared<std::atomic<bool>>(false);
  EXPECT_LT(secondsToEnd([done](CallBreaker*) {
              usleep(200000);
              *done = true;
              return ServiceAnswer();
            }),
            0.9);
  EXPECT_TRUE(*done);
  const auto gate = std::make_shared<std::mutex>();
  gate->lock();
  const auto hung = std::make_shared<std::atomic<bool>>(true);
  const double waited = secondsToEnd([gate, hung](CallBreaker*) {
    const std::lock_guard<std::mutex> lock(*gate);
    *hung = false;
    return ServiceAnswer();
  });
  EXPECT_GT(waited, 0.5);
  EXPECT_LT(waited, 2.0);
  EXPECT_TRUE(*hung);
  gate->unlock();  // the thread goes on with what it holds, and ends
  for (int i = 0; i < 1000 && *hung; ++i) usleep(10000);
  EXPECT_FALSE(*hung);
}

TEST(ServiceCaller, OneCallAtATimeAndItsAnswerOnce) {
  ServiceCaller caller;
  std::mutex gate;
  gate.lock();
  ASSERT_TRUE(caller.start([&gate](CallBreaker*) {
    const std::lock_guard<std::mutex> lock(gate);
    return ServiceAnswer{true, "done"};
  }));
  EXPECT_TRUE(caller.busy());
  EXPECT_FALSE(caller.start([](CallBreaker*) { return ServiceAnswer(); }));
  EXPECT_FALSE(caller.takeAnswer());
  gate.unlock();
  std::optional<ServiceAnswer> answer = awaitAnswer(&caller);
  ASSERT_TRUE(answer);
  EXPECT_TRUE(answer->success);
  EXPECT_EQ(answer->message, "done");
  EXPECT_FALSE(caller.busy());
  EXPECT_FALSE(caller.takeAnswer());
  ASSERT_TRUE(
      caller.start([](CallBreaker*) -> ServiceAnswer { throw std::runtime_error("the name is invalid"); }));
  for (answer.reset(); !answer; answer = caller.takeAnswer()) usleep(1000);
  EXPECT_FALSE(answer->success);
  EXPECT_EQ(answer->message, "the name is invalid");
}

TEST(ServiceCaller, BreaksOffACallThatHangs) {
  ServiceCaller caller(std::chrono::milliseconds(200));
  const auto gate = std::make_shared<std::mutex>();
  gate->lock();
  const auto ended = std::make_shared<std::atomic<bool>>(false);
  ASSERT_TRUE(caller.start([gate, ended](CallBreaker* breaker) {
    breaker->onBreak([gate] { gate->unlock(); });
    const std::lock_guard<std::mutex> lock(*gate);
    *ended = true;
    return ServiceAnswer();
  }));
  const std::optional<ServiceAnswer> answer = awaitAnswer(&caller);
  ASSERT_TRUE(answer);
  EXPECT_FALSE(answer->success);
  EXPECT_NE(answer->message.find("no answer for 0.2 s"), std::string::npos) << answer->message;
  EXPECT_FALSE(caller.busy());
  for (int i = 0; i < 1000 && !*ended; ++i) usleep(10000);
  EXPECT_TRUE(*ended) << "its thread is left behind";
}

TEST(ServiceCaller, AnAnswerThatComesTooLateIsDropped) {
  ServiceCaller caller(std::chrono::milliseconds(200));
  const auto gate = std::make_shared<std::mutex>();
  gate->lock();
  const auto ended = std::make_shared<std::atomic<bool>>(false);
  ASSERT_TRUE(caller.start([gate, ended](CallBreaker*) {
    const std::lock_guard<std::mutex> lock(*gate);
    *ended = true;
    return ServiceAnswer{true, "too late"};
  }));
  ASSERT_TRUE(awaitAnswer(&caller));
  ASSERT_TRUE(caller.start([](CallBreaker*) {
    usleep(50000);
    return ServiceAnswer{true, "the second"};
  }));
  gate->unlock();
  for (int i = 0; i < 1000 && !*ended; ++i) usleep(10000);
  const std::optional<ServiceAnswer> answer = awaitAnswer(&caller);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->message, "the second");
  EXPECT_FALSE(caller.takeAnswer());
}

TEST(CallBreaker, EndsACallThatSaysTooLateHow) {
  CallBreaker breaker;
  breaker.breakOff();
  bool ended = false;
  breaker.onBreak([&ended] { ended = true; });
  EXPECT_TRUE(ended);
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  setenv("QT_QPA_PLATFORM", "offscreen", 0);
  testing::InitGoogleTest(&argc, argv);
  QApplication application(argc, argv);
  return RUN_ALL_TESTS();
}
