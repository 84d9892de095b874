#include "client/watch/player.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "client/clock/clock.h"
#include "client/link/recording.h"
#include "client/servo/states.h"

namespace teletact::client {
namespace {

// Several recordings as one, by time.
class Entries {
 public:
  explicit Entries(const std::vector<std::string>& paths) {
    for (const std::string& path : paths) {
      readers_.push_back(std::make_unique<RecordReader>(path));
      v1::RecordEntry header;
      *header.mutable_header() = readers_.back()->header();
      next_.push_back(std::move(header));
    }
  }
  std::optional<v1::RecordEntry> next() {
    std::size_t first = next_.size();
    for (std::size_t n = 0; n < next_.size(); ++n)
      if (next_[n] && (first == next_.size() || next_[n]->monotonic_ns() < next_[first]->monotonic_ns()))
        first = n;
    if (first == next_.size()) return std::nullopt;
    std::optional<v1::RecordEntry> out = std::move(next_[first]);
    next_[first] = readers_[first]->next();
    return out;
  }

 private:
  std::vector<std::unique_ptr<RecordReader>> readers_;
  std::vector<std::optional<v1::RecordEntry>> next_;
};

}  // namespace

Player::Player(std::vector<std::string> paths, View& view) : paths_(std::move(paths)), view_(view) {
  index();
  thread_ = std::thread([this] { run(); });
}

Player::~Player() {
  {
    const std::lock_guard lock(mutex_);
    orders_.stop = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Player::index() {
  constexpr std::size_t kMaxSpells = 2000;
  nlohmann::json spells = nlohmann::json::array();
  std::uint32_t last = ~0U;
  Entries entries(paths_);
  while (const auto entry = entries.next()) {
    if (entry->has_header()) continue;
    if (entry->has_scene()) {  // as it stood at the end
      has_maps_ = has_maps_ || entry->scene().has_youngs_modulus();
      view_.take_scene(entry->scene());
    }
    if (!entry->has_servo()) continue;
    if (begin_ns_ == 0) begin_ns_ = entry->monotonic_ns();
    end_ns_ = std::max(end_ns_, entry->monotonic_ns());
    const v1::ServoSample& tick = entry->servo();
    const std::uint32_t now = (tick.state() & 3U) | (tick.degraded() ? 4U : 0) | (tick.faded() ? 8U : 0);
    if (now == last || spells.size() >= kMaxSpells) continue;
    last = now;
    spells.push_back({{"at_s", seconds_between(begin_ns_, entry->monotonic_ns())},
                      {"state", name(static_cast<ServoState>(tick.state() & 3U))},
                      {"reason", describe(static_cast<StateReason>(tick.reason()))},
                      {"degraded", tick.degraded()},
                      {"faded", tick.faded()}});
  }
  if (begin_ns_ == 0)
    throw std::runtime_error("'" + paths_.front() + "' holds no touch; give a touch --record file");
  view_.tell_timeline({{"length_s", length_s()}, {"spells", spells}});
}

double Player::length_s() const {
  return seconds_between(begin_ns_, end_ns_);
}

void Player::begin() {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(orders_.begun, true)) return;
  }
  changed_.notify_all();
}

void Player::obey(const nlohmann::json& order) {
  const auto number = [&](const char* name) -> std::optional<double> {
    const auto found = order.find(name);
    if (found == order.end() || !found->is_number()) return std::nullopt;
    const double value = found->get<double>();
    return std::isfinite(value) ? std::optional(value) : std::nullopt;
  };
  {
    const std::lock_guard lock(mutex_);
    if (const auto speed = number("speed"))
      orders_.speed = *speed <= 0 ? 0 : std::clamp(*speed, kSlowest, kFastest);
    if (const auto seek_s = number("seek_s")) orders_.seek_s = std::clamp(*seek_s, 0.0, length_s());
    orders_.begun = true;
  }
  changed_.notify_all();
}

void Player::say() {
  view_.tell("playing", {{"at_s", std::round(at_s_ * 20) / 20},
                         {"length_s", length_s()},
                         {"speed", orders_.speed},
                         {"over", over_}});
}

bool Player::wait_until(double at_s) {
  constexpr double kStepS = 0.02;
  std::unique_lock lock(mutex_);
  while (true) {
    if (orders_.stop || orders_.seek_s) return false;
    if (std::isinf(at_s)) {
      at_s_ = length_s();
      over_ = true;
      say();
      changed_.wait(lock);
      continue;
    }
    if (!orders_.begun) {
      changed_.wait(lock);
      continue;
    }
    const double left_s = at_s - at_s_;
    if (orders_.speed > 0 && left_s <= 0) return true;
    const auto before = std::chrono::steady_clock::now();
    const double wait_s = orders_.speed > 0 ? std::min(left_s / orders_.speed, kStepS) : 1;
    const double speed = orders_.speed;
    changed_.wait_for(lock, std::chrono::duration<double>(wait_s));
    at_s_ += speed * std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    say();
  }
}

void Player::play(double from_s) {
  view_.restart();
  Entries entries(paths_);
  view_.tell("session", nullptr);
  {
    const std::lock_guard lock(mutex_);
    at_s_ = from_s;
    over_ = false;
    say();
  }
  while (true) {
    const auto entry = entries.next();
    if (!entry) view_.complete_row();
    // What was written after the last tick comes with it.
    const double entry_s = !entry ? std::numeric_limits<double>::infinity()
                           : entry->has_header()
                               ? 0
                               : std::min(length_s(), seconds_between(begin_ns_, entry->monotonic_ns()));
    if (entry_s > at_s_ && !wait_until(entry_s)) return;
    if (!entry->has_scene()) view_.take(*entry);
  }
}

void Player::run() {
  double from_s = 0;
  while (true) {
    try {
      play(from_s);
    } catch (const std::exception& error) {  // a file that was there when it began
      view_.tell("session", std::string("broken off: ") + error.what());
      const std::lock_guard lock(mutex_);
      over_ = true;
      say();
    }
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return orders_.stop || orders_.seek_s; });
    if (orders_.stop) return;
    from_s = *orders_.seek_s;
    orders_.seek_s.reset();
  }
}

}  // namespace teletact::client
