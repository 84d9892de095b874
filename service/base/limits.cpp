#include "service/base/limits.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

namespace teletact::service {

namespace {

constexpr double kKiB = 1024, kMiB = 1024 * kKiB, kGiB = 1024 * kMiB;

using L = Limits;

}  // namespace

// What an operator of a compute node sets has a range; it ends where the numbers behind it were tested, or
// where a larger value serves nobody. The minimum and the maximum of one thing have ranges that do not
// overlap, so that any two that are set fit together.
const std::vector<LimitRow>& limit_rows() {
  static const std::vector<LimitRow> rows{
      // Frames first: what a client asks for most.
      {"max_frame_bytes", &L::max_frame_bytes, "B", 64 * kKiB, 256 * kMiB, "one RF frame"},
      {"max_chunk_bytes", &L::max_chunk_bytes, "B"},
      {"host_memory_bytes", &L::host_memory_bytes, "B", 0, 1024 * kGiB,
       "memory of the host that may be held; 0: a quarter of it"},
      {"device_memory_bytes", &L::device_memory_bytes, "B", 0, 1024 * kGiB,
       "memory of each device that may be held; 0: half of the smallest one's"},
      {"client_memory_share", &L::client_memory_share, "1", 0.001, 1, "part of either for one client"},
      {"max_scenes", &L::max_scenes, "1", 1, 4096, "scenes at once"},
      {"max_scene_elements", &L::max_scene_elements, "1"},
      {"max_scene_columns", &L::max_scene_columns, "1"},
      {"max_solid_elements", &L::max_solid_elements, "1"},
      {"max_windows", &L::max_windows, "1"},
      {"min_scene_m", &L::min_scene_m, "m"},
      {"max_scene_width_m", &L::max_scene_width_m, "m"},
      {"max_scene_depth_m", &L::max_scene_depth_m, "m"},
      {"min_thickness_m", &L::min_thickness_m, "m"},
      {"max_thickness_m", &L::max_thickness_m, "m"},
      {"min_samples", &L::min_samples, "1"},
      {"max_samples", &L::max_samples, "1"},
      {"min_lines", &L::min_lines, "1"},
      {"max_lines", &L::max_lines, "1"},
      {"min_center_frequency_hz", &L::min_center_frequency_hz, "Hz"},
      {"max_center_frequency_hz", &L::max_center_frequency_hz, "Hz"},
      {"min_sound_speed_m_s", &L::min_sound_speed_m_s, "m/s"},
      {"max_sound_speed_m_s", &L::max_sound_speed_m_s, "m/s"},
      {"min_line_pitch_m", &L::min_line_pitch_m, "m"},
      {"max_line_pitch_m", &L::max_line_pitch_m, "m"},
      {"max_window_width_m", &L::max_window_width_m, "m"},
      {"max_first_sample_depth_m", &L::max_first_sample_depth_m, "m"},
      {"min_tissue_depth_m", &L::min_tissue_depth_m, "m"},
      {"max_tissue_depth_m", &L::max_tissue_depth_m, "m"},
      {"max_tissue_width_m", &L::max_tissue_width_m, "m"},
      {"min_probe_force_n", &L::min_probe_force_n, "N"},
      {"max_probe_force_n", &L::max_probe_force_n, "N"},
      {"min_probe_elevation_m", &L::min_probe_elevation_m, "m"},
      {"max_probe_elevation_m", &L::max_probe_elevation_m, "m"},
      {"min_max_strain", &L::min_max_strain, "1"},
      {"max_max_strain", &L::max_max_strain, "1"},
      {"min_modulus_time_s", &L::min_modulus_time_s, "s"},
      {"max_modulus_time_s", &L::max_modulus_time_s, "s"},
      {"max_credit", &L::max_credit, "1"},
      {"max_touch_rate_hz", &L::max_touch_rate_hz, "Hz", 20, 1000, "answers of a touch stream"},
      {"min_touch_rate_hz", &L::min_touch_rate_hz, "Hz", 1, 20,
       "answers that a busy service leaves a touch stream that wants more; where it cannot, one more is "
       "refused"},
      {"max_touch_period_s", &L::max_touch_period_s, "s"},
      {"max_finger_rate_hz", &L::max_finger_rate_hz, "Hz"},
      {"max_observe_rate_hz", &L::max_observe_rate_hz, "Hz"},
      {"min_tip_m", &L::min_tip_m, "m"},
      {"max_tip_m", &L::max_tip_m, "m"},
      {"max_touch_streams", &L::max_touch_streams, "1", 1, 4096, "touch streams at once"},
      {"max_watchers", &L::max_watchers, "1", 1, 4096, "watchers of fingers at once"},
      {"max_observers", &L::max_observers, "1", 1, 4096, "observers of scenes at once"},
      {"max_estimates", &L::max_estimates, "1", 1, 256, "uploads and estimates at once"},
      {"max_unary_calls", &L::max_unary_calls, "1", 1, 4096, "other calls at once"},
      {"max_full_scenes", &L::max_full_scenes, "1", 1, 64, "GetScene with maps at once"},
      {"touch_workers", &L::touch_workers, "1", 0, 256,
       "threads that answer touches; 0: as many as cores; at least 2"},
      {"max_threads", &L::max_threads, "1", 16, 4096, "threads of calls"},
      {"first_message_s", &L::first_message_s, "s"},
      {"acknowledge_s", &L::acknowledge_s, "s", 0.1, 600,
       "that an answer or a finger's state waits to be acknowledged"},
      {"answer_taken_s", &L::answer_taken_s, "s"},
      {"touch_idle_s", &L::touch_idle_s, "s", 1, 3600, "silence that ends a touch stream"},
      {"upload_idle_s", &L::upload_idle_s, "s"},
      {"min_upload_s", &L::min_upload_s, "s"},
      {"min_upload_rate", &L::min_upload_rate, "B/s"},
      {"max_finish_within_s", &L::max_finish_within_s, "s"},
      {"unready_s", &L::unready_s, "s", 0, 300,
       "from the signal to stop, all is served on, but the service is not ready: proxies notice"},
      {"move_s", &L::move_s, "s", 0.1, 300,
       "after that, for touches to go to the service that stood by (--standby)"},
      {"drain_s", &L::drain_s, "s", 0.1, 60, "time to end calls when the service is stopped"},
  };
  return rows;
}

double LimitRow::value(const Limits& limits) const {
  return std::visit([&](auto at) { return static_cast<double>(limits.*at); }, member);
}

void set_limit(Limits& limits, std::string_view name, double value) {
  const auto& rows = limit_rows();
  const auto row = std::find_if(rows.begin(), rows.end(), [&](const auto& r) { return name == r.name; });
  if (row == rows.end()) {
    for (const auto& [old, now] : {std::pair{"most_", "max_"}, {"least_", "min_"}})
      for (const LimitRow& r : rows)
        if (std::string_view(r.name).starts_with(now) && name == old + std::string(r.name).substr(4))
          throw std::invalid_argument(fmt::format("{}: it is called {} now", name, r.name));
    throw std::invalid_argument(fmt::format("{}: no such limit; GetInfo names them", name));
  }
  if (!row->meaning)
    throw std::invalid_argument(
        fmt::format("{}: it is a constant, {}; take the line out", name, row->value(limits)));
  if (!(value >= row->min && value <= row->max))
    throw std::invalid_argument(fmt::format("{}: {} is not within [{}, {}] {}; it is for {}", name, value,
                                            row->min, row->max, row->unit, row->meaning));
  if (const auto* count = std::get_if<std::uint64_t Limits::*>(&row->member)) {
    if (value != std::floor(value))
      throw std::invalid_argument(fmt::format("{}: {} is not a whole number", name, value));
    limits.** count = static_cast<std::uint64_t>(value);
  } else {
    limits.*std::get<double Limits::*>(row->member) = value;
  }
}

Limits resolved(Limits limits, std::uint64_t host_bytes, std::uint64_t device_bytes) {
  if (limits.host_memory_bytes == 0) limits.host_memory_bytes = host_bytes / 4;
  if (limits.device_memory_bytes == 0) limits.device_memory_bytes = device_bytes / 2;
  if (limits.touch_workers == 0) limits.touch_workers = std::max(1U, std::thread::hardware_concurrency());
  return limits;
}

std::uint64_t host_memory_bytes(const std::filesystem::path& own, const std::filesystem::path& groups) {
  const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
  if (pages <= 0 || page_bytes <= 0) return 0;
  std::uint64_t bytes = static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page_bytes);
  constexpr std::string_view kOfVersion2 = "0::/";
  std::filesystem::path group;
  std::ifstream file(own);
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(kOfVersion2)) group = line.substr(kOfVersion2.size());
  while (true) {
    std::uint64_t most = 0;
    if (std::ifstream(groups / group / "memory.max") >> most && most > 0)  // "max" is no number
      bytes = std::min(bytes, most);
    if (group.empty()) return bytes;
    group = group.parent_path();
  }
}

}  // namespace teletact::service
