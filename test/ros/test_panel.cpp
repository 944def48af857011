// The panel as rviz loads it: as a plugin, on a display, with topics and services of a nodelet that this program plays.
#include <autocal_vio/CalibrationStatus.h>
#include <autocal_vio/FreezeExtrinsics.h>
#include <autocal_vio/Reset.h>
#include <autocal_vio/SaveCalibration.h>
#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <rviz/config.h>
#include <rviz/panel.h>

#include <QAction>
#include <QApplication>
#include <QElapsedTimer>
#include <QLineEdit>
#include <QMenu>
#include <QPushButton>
#include <QToolButton>
#include <atomic>
#include <functional>
#include <mutex>
#include <pluginlib/class_loader.hpp>

#include "autocal_vio/rviz/autocal_panel.h"
#include "autocal_vio/rviz/control_bar.h"
#include "autocal_vio/rviz/settings_form.h"
#include "autocal_vio/rviz/status_view.h"
#include "example_status.h"

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

  std::atomic<bool> slow{false};  ///< answers take two seconds
  std::mutex mutex;
  std::optional<FreezeExtrinsics::Request> froze;
  std::optional<Reset::Request> reset_with;
  std::optional<SaveCalibration::Request> saved;

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
    const std::lock_guard<std::mutex> lock(mutex);
    froze = request;
    response.success = true;
    response.message = "held";
    return true;
  }

  bool save(SaveCalibration::Request& request, SaveCalibration::Response& response) {
    const std::lock_guard<std::mutex> lock(mutex);
    saved = request;
    response.message = "the folder cannot be written";
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

TEST_F(Panel, MessagesArriveAtSpeed) {
  ASSERT_TRUE(waitFor([] { return nodelet_->listeners() >= 1; }));
  EXPECT_TRUE(waitFor([] { return view()->reasonText().contains("first message"); }))
      << qPrintable(view()->reasonText());
  constexpr std::uint64_t kImages = 4000;  // of 200 s, in about two
  for (std::uint64_t image = 1; image <= kImages; ++image) {
    nodelet_->publish(image);
    if (image % 100 == 0) waitFor([] { return false; }, 50);
  }
  ASSERT_TRUE(waitFor(
      [] { return !panel_->history().empty() && panel_->history().latest().images_processed == kImages; }));
  EXPECT_EQ(view()->stateText(), "converged");
  EXPECT_EQ(panel_->history().end() - panel_->history().begin(), fromSeconds(0.05 * (kImages - 1)));
}

TEST_F(Panel, ABagThatStartsAnewIsANewHistory) {
  nodelet_->publish(5000, 100.0);
  EXPECT_TRUE(waitFor([] { return panel_->history().begin() == panel_->history().end(); }));
}

TEST_F(Panel, ButtonsReachTheServices) {
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
  const auto rvizListens = [] {
    XmlRpc::XmlRpcValue request, response, payload;
    request[0] = ros::this_node::getName();
    if (!ros::master::execute("getSystemState", request, response, payload, false)) return false;
    for (int i = 0; i < payload[1].size(); ++i) {
      if (std::string(payload[1][i][0]) != "/vio/calibration_status") continue;
      for (int k = 0; k < payload[1][i][1].size(); ++k) {
        if (std::string(payload[1][i][1][k]) == "/rviz") return true;
      }
    }
    return false;
  };
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
