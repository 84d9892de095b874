// What the page shows: the newest of each channel, from the entries of a session or a recording, and maps
// from the service. Thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "client/watch/frame.h"
#include "client/watch/scene_maps.h"
#include "client/watch/trace.h"
#include "teletact/v1/palpation.pb.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

class View {
 public:
  static constexpr std::size_t kLines = 40, kWindows = 40;
  static constexpr double kStatusS = 0.1;  // between states of the status, in the session's time

  // How far a viewer is: what it has been sent of each channel.
  struct Seen {
    std::array<std::uint64_t, kChannels> version{};
    std::uint64_t row = 0;
    std::uint64_t era = 0;
  };

  // Called when there is something new, by any thread, one at a time; the one before is not called any more.
  // It takes no news itself.
  void on_change(std::function<void()> changed);
  // An entry of the operator's session, or of the patient's.
  void take(const v1::RecordEntry& entry);
  void take_scene(const v1::Scene& scene);
  // What Observe says of the scene: its windows, maps, how the touched layer gives way.
  void take_observed(const v1::Observation& seen);
  // Who told it has ended: how the layer lies is not known any more, and the next one's maps are others.
  // `elsewhere`: it looks at another scene from now on, and nothing is known of that one yet.
  void look_away(bool elsewhere = false);
  // What else the status says, by name: where the entries come from, and whether they still do.
  void tell(const std::string& name, nlohmann::json value);
  void tell_timeline(nlohmann::json timeline);
  // No tick comes for now: the row of the last ones is shown as it is.
  void complete_row();
  // Another session, or the same from an earlier place: what came is forgotten.
  void restart();

  // All that is newer than what was seen, which becomes so; empty: nothing.
  std::vector<std::shared_ptr<const std::string>> news(Seen& seen);
  v1::RecordHeader header() const;
  std::string session_id() const;  // of the touch stream that is shown; empty: none was opened

 private:
  void put(Channel channel, const Slot& slot);
  void take_tick(const v1::RecordEntry& entry);
  void take_answer(const v1::TouchAnswer& answer);
  void take_estimate(const v1::RecordEntry& entry);
  void take_window(const v1::RecordEntry& entry);
  void put_status(std::int64_t time_ns, bool at_once);
  void put_windows();
  void put_scene(const v1::Scene& scene);
  void put_maps();
  void put_surface(const v1::DeformedSurface& surface);
  void notify();

  std::mutex calling_;
  std::function<void()> changed_ = [] {};
  mutable std::mutex mutex_;  // all below
  v1::RecordHeader header_;
  Trace trace_;
  std::array<std::uint64_t, kChannels> version_{};
  std::array<std::shared_ptr<const std::string>, kChannels> slot_{};
  std::uint64_t era_ = 1;
  std::optional<v1::ForceBudget> budget_;
  nlohmann::json told_ = nlohmann::json::object(), answer_, figures_, opened_;
  std::deque<nlohmann::json> lines_;
  std::int64_t status_ns_ = 0;
  std::map<std::uint32_t, nlohmann::json> windows_;  // by call
  SceneMaps maps_;
  bool away_ = false;  // since maps_ were told
};

}  // namespace teletact::client
