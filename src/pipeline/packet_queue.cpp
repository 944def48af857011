#include "autocal_vio/pipeline/packet_queue.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace autocal_vio {
namespace {

template <class T>
bool holds(const Packet& packet) {
  return std::holds_alternative<T>(packet);
}

}  // namespace

PacketQueue::PacketQueue(const PacketQueueOptions& options) : options_(options) {
  std::string text;
  for (const std::string& violation : validateOptions(options))
    text += (text.empty() ? "" : "; ") + violation;
  if (!text.empty()) throw std::invalid_argument("packet queue: " + text);
}

bool PacketQueue::push(Packet packet) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (closed_) return false;
    if (holds<ImageFrame>(packet)) {
      if (counters_.images_waiting >= options_.max_images) dropOldestImage();
      ++counters_.images_waiting;
    } else if (holds<ImuSample>(packet)) {
      const TimeNs stamp = std::get<ImuSample>(packet).stamp;
      while (counters_.imu_waiting >= options_.max_imu_samples || imuSpanExceeded(stamp)) dropOldestImu();
      ++counters_.imu_waiting;
    } else {
      if (commands_waiting_ >= options_.max_commands) return false;
      ++commands_waiting_;
    }
    packets_.push_back(std::move(packet));
  }
  not_empty_.notify_one();
  return true;
}

std::optional<Packet> PacketQueue::pop() {
  std::unique_lock<std::mutex> lock(mutex_);
  not_empty_.wait(lock, [this] { return closed_ || !packets_.empty(); });
  if (closed_) return std::nullopt;
  Packet packet = std::move(packets_.front());
  packets_.pop_front();
  if (holds<ImageFrame>(packet)) {
    --counters_.images_waiting;
  } else if (holds<ImuSample>(packet)) {
    --counters_.imu_waiting;
  } else {
    --commands_waiting_;
  }
  return packet;
}

void PacketQueue::clearData() {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto is_data = [](const Packet& packet) { return !holds<Command>(packet); };
  packets_.erase(std::remove_if(packets_.begin(), packets_.end(), is_data), packets_.end());
  counters_.images_waiting = 0;
  counters_.imu_waiting = 0;
}

void PacketQueue::close() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
  }
  not_empty_.notify_all();
}

PacketQueue::Counters PacketQueue::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

void PacketQueue::dropOldestImage() {
  packets_.erase(std::find_if(packets_.begin(), packets_.end(), holds<ImageFrame>));
  --counters_.images_waiting;
  ++counters_.images_dropped;
}

void PacketQueue::dropOldestImu() {
  packets_.erase(std::find_if(packets_.begin(), packets_.end(), holds<ImuSample>));
  --counters_.imu_waiting;
  ++counters_.imu_dropped;
}

bool PacketQueue::imuSpanExceeded(TimeNs newest) const {
  if (counters_.imu_waiting == 0) return false;
  const auto oldest = std::find_if(packets_.begin(), packets_.end(), holds<ImuSample>);
  return newest - std::get<ImuSample>(*oldest).stamp > options_.max_imu_span;
}

}  // namespace autocal_vio
