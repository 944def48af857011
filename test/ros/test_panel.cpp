// The panel as rviz loads it: as a plugin, on a display, with topics and services of a nodelet that this program plays.
#include <autocal_vio/CalibrationStatus.h>
#include <autocal_vio/FreezeExtrinsics.h>
#include <autocal_vio/Reset.h>
#include <autocal_vio/SaveCalibration.h>
#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <rviz/config.h>
#include <rviz/panel.h>
#include <xmlrpcpp/XmlRpc.h>

#include <QAction>
#include <QApplication>
#include <QElapsedTimer>
#include <QLabel>
#include <QLineEdit>
#include <QMenu>
#include <QPushButton>
#include <QToolButton>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <pluginlib/class_loader.hpp>
#include <string>
#include <vector>

#include "autocal_vio/rviz/autocal_panel.h"
#include "autocal_vio/rviz/control_bar.h"
#include "autocal_vio/rviz/convergence_plots.h"
#include "autocal_vio/rviz/settings_form.h"
#include "autocal_vio/rviz/status_view.h"
#include "example_status.h"
#include "process_load.h"

namespace autocal_vio {
namespace {

/// The longest time that Qt's events were held up, while waiting [ms].
qint64 longest_pause = 0;

/// Lets Qt run until the condition holds.
bool waitFor(const std::function<bool()>& condition, int milliseconds = 20000) {
  QElapsedTimer total, pause;
  for (total.start(); total.elapsed() < milliseconds;) {
    if (condition()) return true;
    pause.start();
    QApplication::processEvents(QEventLoop::AllEvents, 20);
    longest_pause = std::max(longest_pause, pause.elapsed());
    ros::WallDuration(0.005).sleep();
  }
  return condition();
}

/// Asks a node's master, or the node itself.
XmlRpc::XmlRpcValue ask(const std::string& what, const std::string& node = "") {
  XmlRpc::XmlRpcValue request, response, payload;
  request[0] = ros::this_node::getName();
  if (!node.empty()) request[1] = node;
  ros::master::execute(what, request, response, payload, false);
  return payload;
}

bool rvizListens() {
  XmlRpc::XmlRpcValue state = ask("getSystemState");
  if (!state.valid()) return false;
  for (int i = 0; i < state[1].size(); ++i) {
    if (std::string(state[1][i][0]) != "/vio/calibration_status") continue;
    for (int k = 0; k < state[1][i][1].size(); ++k) {
      if (std::string(state[1][i][1][k]) == "/rviz") return true;
    }
  }
  return false;
}

/// The number of rviz's process.
std::string rvizProcess() {
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(std::string(ask("lookupNode", "/rviz")), host, port)) return "";
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  XmlRpc::XmlRpcValue request, response;
  request[0] = ros::this_node::getName();
  if (!client.execute("getPid", request, response)) return "";
  return std::to_string(static_cast<int>(response[2]));
}

/// What the panel asks for and hears.
class FakeNodelet {
 public:
  FakeNodelet() : spinner_(2), nh_("/vio") {
    publisher_ = nh_.advertise<CalibrationStatus>("calibration_status", 5000);
    reset_ = nh_.advertiseService("reset", &FakeNodelet::reset, this);
    freeze_ = nh_.advertiseService("freeze_extrinsics", &FakeNodelet::freeze, this);
    save_ = nh_.advertiseService("save_calibration", &FakeNodelet::save, this);
    spinner_.start();
  }

  void publish(std::uint64_t image, double start = 1000.0) {
    publisher_.publish(exampleStatus(image, start));
  }
  std::uint32_t listeners() const { return publisher_.getNumSubscribers(); }

  std::atomic<bool> slow{false};   ///< answers to freeze take two seconds
  std::atomic<bool> hangs{false};  ///< or do not come
  std::atomic<int> hanging{0};     ///< calls that wait for that
  std::mutex mutex;
  std::optional<FreezeExtrinsics::Request> froze;
  std::optional<Reset::Request> reset_with;
  std::optional<SaveCalibration::Request> saved;
  SaveCalibration::Response save_answer;

 private:
  bool reset(Reset::Request& request, Reset::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex);
    reset_with = request;
    response.success = true;
    response.message = "started anew";
    return true;
  }

  bool freeze(FreezeExtrinsics::Request& request, FreezeExtrinsics::Response& response) {
    if (slow) ros::WallDuration(2.0).sleep();
    ++hanging;
    while (hangs && ros::ok()) ros::WallDuration(0.01).sleep();
    --hanging;
    const std::lock_guard<std::mutex> lock(mutex);
    froze = request;
    response.success = true;
    response.message = "held";
    return true;
  }

  bool save(SaveCalibration::Request& request, SaveCalibration::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex);
    saved = request;
    response = save_answer;
    return true;
  }

  ros::AsyncSpinner spinner_;
  ros::NodeHandle nh_;
  ros::Publisher publisher_;
  ros::ServiceServer reset_, freeze_, save_;
};

class Panel : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    nodelet_ = new FakeNodelet;
    loader_ = new pluginlib::ClassLoader<rviz::Panel>("rviz", "rviz::Panel");
    plugin_ = loader_->createUnmanagedInstance("autocal_vio/AutocalPanel");
    panel_ = dynamic_cast<AutocalPanel*>(plugin_);
    if (!panel_) return;
    plugin_->resize(600, 900);
    plugin_->show();
    plugin_->initialize(nullptr);
  }

  static void TearDownTestSuite() {
    delete plugin_;
    delete nodelet_;
    delete loader_;
  }

  void SetUp() override {
    ASSERT_NE(panel_, nullptr) << "the plugin is not the class of this program's library";
  }

  static QAbstractButton* button(const QString& text) {
    for (QAbstractButton* candidate : panel_->findChildren<QAbstractButton*>()) {
      if (candidate->text() == text) return candidate;
    }
    return nullptr;
  }
  static StatusView* view() { return panel_->findChild<StatusView*>(); }
  static ControlBar* controls() { return panel_->findChild<ControlBar*>(); }
  static bool answered(const QString& sentence) {
    return waitFor([&] { return controls()->answerText() == sentence; });
  }

  static FakeNodelet* nodelet_;
  static pluginlib::ClassLoader<rviz::Panel>* loader_;
  static rviz::Panel* plugin_;
  static AutocalPanel* panel_;
};

FakeNodelet* Panel::nodelet_ = nullptr;
pluginlib::ClassLoader<rviz::Panel>* Panel::loader_ = nullptr;
rviz::Panel* Panel::plugin_ = nullptr;
AutocalPanel* Panel::panel_ = nullptr;

/// Counts how often widgets are painted.
class PaintCounter : public QObject {
 public:
  void watch(QObject* widget) { widget->installEventFilter(this); }
  std::size_t count() const { return count_; }

 private:
  bool eventFilter(QObject* /*widget*/, QEvent* event) override {
    count_ += event->type() == QEvent::Paint;
    return false;
  }

  std::size_t count_ = 0;
};

/// CPU time that Qt's thread needs to draw what has come on one of the tabs [ms].
double redraw(AutocalPanel* panel, int page) {
  panel->findChild<ConvergencePlots*>()->setCurrentIndex(page);
  QApplication::processEvents();
  const double start = cpuMilliseconds();
  panel->refresh();
  QApplication::processEvents();
  return cpuMilliseconds() - start;
}

// As fast as the panel takes it, which is five times a second. rviz listens with a panel of its own.
TEST_F(Panel, TwentyMinutesOfMessagesAtSpeed) {
  ASSERT_TRUE(waitFor(rvizListens, 60000));
  ASSERT_TRUE(waitFor([] { return nodelet_->listeners() >= 2; }));
  EXPECT_TRUE(waitFor([] { return view()->reasonText().contains("first message"); }))
      << qPrintable(view()->reasonText());
  constexpr std::uint64_t kMessages = 24000, kBurst = 400;  // images at 20 Hz
  auto* plots = panel_->findChild<ConvergencePlots*>();
  PaintCounter paints;
  for (const int page : {0, 1}) paints.watch(plots->widget(page));
  const std::string rviz = rvizProcess();
  double memory = 0.0, memory_of_rviz = 0.0;
  std::vector<double> times;
  QElapsedTimer clock;
  clock.start();
  for (std::uint64_t image = 1; image <= kMessages; ++image) {
    nodelet_->publish(image);
    if (image % kBurst != 0) continue;
    ASSERT_TRUE(waitFor([image] {
      return !panel_->history().empty() && panel_->history().latest().images_processed == image;
    }));
    for (const int page : {1, 0}) times.push_back(redraw(panel_, page));
    if (image > kBurst) continue;
    memory = residentMegabytes();
    memory_of_rviz = residentMegabytes(rviz);
  }
  const double growth = residentMegabytes() - memory,
               growth_of_rviz = residentMegabytes(rviz) - memory_of_rviz;
  const RedrawTimes redraws(times);
  std::printf(
      "twenty minutes in %.0f s; memory grew by %.1f MB to %.0f MB, that of rviz by %.1f MB to %.0f MB\n",
      1e-3 * static_cast<double>(clock.elapsed()), growth, memory + growth, growth_of_rviz,
      memory_of_rviz + growth_of_rviz);
  EXPECT_EQ(view()->stateText(), "converged");
  EXPECT_EQ(panel_->history().end() - panel_->history().begin(), fromSeconds(0.05 * (kMessages - 1)));
  EXPECT_GE(paints.count(), times.size());
  EXPECT_LT(growth, 10.0) << "a history that keeps all samples takes 17";
  EXPECT_LT(growth_of_rviz, 100.0);
  EXPECT_LT(redraws.median, 20.0);
  EXPECT_LT(redraws.nearly_all, 20.0);
}

TEST_F(Panel, ABagThatStartsAnewIsANewHistory) {
  nodelet_->publish(5000, 100.0);
  EXPECT_TRUE(waitFor([] { return panel_->history().begin() == panel_->history().end(); }));
}

TEST_F(Panel, ButtonsReachTheServices) {
  nodelet_->save_answer.success = false;
  nodelet_->save_answer.message = "the folder cannot be written";
  button("Save")->click();
  ASSERT_TRUE(answered("the folder cannot be written"));
  {
    const std::lock_guard<std::mutex> lock(nodelet_->mutex);
    EXPECT_EQ(nodelet_->saved->camchain_path, panel_->settings().camchain_path.toStdString());
  }
  auto* reset = qobject_cast<QToolButton*>(button("Reset"));
  ASSERT_NE(reset, nullptr);
  for (const bool keep : {true, false}) {
    reset->menu()->actions().at(keep ? 0 : 1)->trigger();
    ASSERT_TRUE(waitFor([] {
      const std::lock_guard<std::mutex> lock(nodelet_->mutex);
      return nodelet_->reset_with.has_value();
    }));
    ASSERT_TRUE(answered("started anew"));
    const std::lock_guard<std::mutex> lock(nodelet_->mutex);
    EXPECT_EQ(nodelet_->reset_with->keep_calibration, keep);
    nodelet_->reset_with.reset();
  }
}

TEST_F(Panel, FreezesThePartsThatAreTickedAndReleasesAll) {
  controls()->setFreezeParts({true, false, true});
  button("Freeze")->click();
  ASSERT_TRUE(answered("held"));
  {
    const std::lock_guard<std::mutex> lock(nodelet_->mutex);
    EXPECT_TRUE(nodelet_->froze->rotation);
    EXPECT_FALSE(nodelet_->froze->translation);
    EXPECT_TRUE(nodelet_->froze->time_offset);
  }
  button("Release")->click();
  EXPECT_EQ(controls()->answerText(), "releasing ...");
  ASSERT_TRUE(answered("held"));
  const std::lock_guard<std::mutex> lock(nodelet_->mutex);
  EXPECT_FALSE(nodelet_->froze->rotation || nodelet_->froze->translation || nodelet_->froze->time_offset);
}

TEST_F(Panel, ASlowServiceDoesNotHoldUpTheWindow) {
  nodelet_->slow = true;
  longest_pause = 0;
  QElapsedTimer time;
  time.start();
  button("Freeze")->click();
  EXPECT_LT(time.elapsed(), 500);
  EXPECT_FALSE(button("Save")->isEnabled());
  ASSERT_TRUE(answered("held"));
  nodelet_->slow = false;
  EXPECT_GT(time.elapsed(), 1900);
  EXPECT_LT(longest_pause, 1000);
  EXPECT_TRUE(button("Save")->isEnabled());
}

TEST_F(Panel, AServiceThatHangsIsGivenUp) {
  const int threads = threadCount();
  nodelet_->hangs = true;
  longest_pause = 0;
  QElapsedTimer time;
  time.start();
  button("Freeze")->click();
  EXPECT_FALSE(button("Save")->isEnabled());
  ASSERT_TRUE(waitFor([] { return controls()->answerText().contains("no answer for 10 s"); }));
  EXPECT_GT(time.elapsed(), 9500);
  EXPECT_LT(time.elapsed(), 13000);
  EXPECT_LT(longest_pause, 1000);
  for (const char* name : {"Freeze", "Release", "Reset", "Save"})
    EXPECT_TRUE(button(name)->isEnabled()) << name;
  EXPECT_TRUE(waitFor([threads] { return threadCount() <= threads; }, 3000)) << "a thread waits on";
  button("Save")->click();  // others answer meanwhile
  const QString answer = QString::fromStdString(nodelet_->save_answer.message);
  ASSERT_TRUE(answered(answer));
  nodelet_->hangs = false;
  waitFor([] { return false; }, 1000);
  EXPECT_EQ(controls()->answerText(), answer) << "what came too late";
}

TEST_F(Panel, MayBeClosedWhileAServiceHangs) {
  const int threads = threadCount();
  nodelet_->hangs = true;
  auto closed = std::make_unique<AutocalPanel>();
  Q_EMIT closed->findChild<ControlBar*>()->freezeWanted();
  EXPECT_TRUE(waitFor([] { return nodelet_->hanging > 0; }));
  QElapsedTimer time;
  time.start();
  closed.reset();
  EXPECT_LT(time.elapsed(), 2000);
  EXPECT_TRUE(waitFor([threads] { return threadCount() <= threads; }, 3000)) << "a thread waits on";
  nodelet_->hangs = false;
  EXPECT_TRUE(waitFor([] { return nodelet_->hanging == 0; }));
}

// The whole sentence, however long the path is.
TEST_F(Panel, SaysWhereTheFileWent) {
  std::string path = "/data/robot";
  for (int i = 0; i < 8; ++i) path += "/a_folder_with_a_long_name";
  nodelet_->save_answer.success = true;
  for (const std::string& file : {std::string("/tmp/camchain-imucam.yaml"), path + "/camchain-imucam.yaml"}) {
    const QString sentence = QString::fromStdString("written: " + file);
    nodelet_->save_answer.message = sentence.toStdString();
    button("Save")->click();
    ASSERT_TRUE(answered(sentence));
    waitFor([] { return false; }, 100);
    const QLabel* label = nullptr;
    for (const QLabel* candidate : controls()->findChildren<QLabel*>()) {
      if (candidate->text() == sentence) label = candidate;
    }
    ASSERT_NE(label, nullptr);
    EXPECT_TRUE(label->isVisible());
    EXPECT_TRUE(label->textInteractionFlags() & Qt::TextSelectableByMouse) << "the path can be copied";
    const QRect needed =
        label->fontMetrics().boundingRect(QRect(0, 0, label->width(), 10000), Qt::TextWordWrap, sentence);
    EXPECT_LE(needed.width(), label->width());
    EXPECT_LE(needed.height(), label->height());
  }
}

TEST_F(Panel, AnotherNameAndAServiceThatIsNotThere) {
  rviz::Config config;
  panel_->save(config);
  rviz::Config other = config;
  other.mapSetValue("Nodelet", "/nobody");
  panel_->load(other);
  EXPECT_TRUE(panel_->history().empty());
  EXPECT_TRUE(
      waitFor([] { return view()->reasonText().contains("Nobody publishes /nobody/calibration_status"); }));
  button("Save")->click();
  EXPECT_TRUE(waitFor(
      [] { return controls()->answerText().contains("there is no service /nobody/save_calibration"); }));
  other.mapSetValue("Nodelet", "not a name");
  panel_->load(other);
  EXPECT_TRUE(waitFor([] { return view()->reasonText().contains("not a name"); }))
      << qPrintable(view()->reasonText());
  button("Save")->click();
  EXPECT_TRUE(waitFor([] { return controls()->answerText().contains("not a name"); }))
      << qPrintable(controls()->answerText());
}

// rviz runs beside this program with the project's config: its panel listens too, and it lives through the messages.
TEST_F(Panel, RvizShowsThePanelOfTheConfig) {
  ASSERT_TRUE(waitFor(rvizListens, 60000));
  ASSERT_TRUE(waitFor([] { return nodelet_->listeners() >= 1; }));
  for (std::uint64_t image = 6000; image < 7000; ++image) {
    nodelet_->publish(image, 2000.0);
    if (image % 10 == 0) waitFor([] { return false; }, 20);
  }
  waitFor([] { return false; }, 2000);
  EXPECT_TRUE(rvizListens());
  EXPECT_GE(nodelet_->listeners(), 1u);
}

}  // namespace
}  // namespace autocal_vio

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_panel");
  QApplication application(argc, argv);
  return RUN_ALL_TESTS();
}
