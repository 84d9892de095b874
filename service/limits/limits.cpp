#include "service/limits/limits.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>

namespace teletact::service {

namespace {

constexpr double kKiB = 1024, kMiB = 1024 * kKiB, kGiB = 1024 * kMiB;

using L = Limits;

}  // namespace

// What an operator of a compute node sets has a range; it ends where the numbers behind it were tested, or
// where a larger value serves nobody. What is least and what is most of one thing have ranges that do not
// overlap, so that any two that are set fit together.
const std::vector<LimitRow>& limit_rows() {
  static const std::vector<LimitRow> rows{
      // Frames first: what a client asks for most.
      {"most_frame_bytes", &L::most_frame_bytes, "B", 64 * kKiB, 256 * kMiB, "one RF frame"},
      {"most_chunk_bytes", &L::most_chunk_bytes, "B"},
      {"host_memory_bytes", &L::host_memory_bytes, "B", 0, 1024 * kGiB,
       "memory of the host that may be held; 0: a quarter of it"},
      {"device_memory_bytes", &L::device_memory_bytes, "B", 0, 1024 * kGiB,
       "memory of each device that may be held; 0: half of the smallest one's"},
      {"client_memory_share", &L::client_memory_share, "1", 0.001, 1, "part of either for one client"},
      {"most_scenes", &L::most_scenes, "1", 1, 4096, "scenes at once"},
      {"most_scene_elements", &L::most_scene_elements, "1"},
      {"most_scene_columns", &L::most_scene_columns, "1"},
      {"most_solid_elements", &L::most_solid_elements, "1"},
      {"most_windows", &L::most_windows, "1"},
      {"least_scene_m", &L::least_scene_m, "m"},
      {"most_scene_width_m", &L::most_scene_width_m, "m"},
      {"most_scene_depth_m", &L::most_scene_depth_m, "m"},
      {"least_thickness_m", &L::least_thickness_m, "m"},
      {"most_thickness_m", &L::most_thickness_m, "m"},
      {"least_samples", &L::least_samples, "1"},
      {"most_samples", &L::most_samples, "1"},
      {"least_lines", &L::least_lines, "1"},
      {"most_lines", &L::most_lines, "1"},
      {"least_center_frequency_hz", &L::least_center_frequency_hz, "Hz"},
      {"most_center_frequency_hz", &L::most_center_frequency_hz, "Hz"},
      {"least_sound_speed_m_s", &L::least_sound_speed_m_s, "m/s"},
      {"most_sound_speed_m_s", &L::most_sound_speed_m_s, "m/s"},
      {"least_line_pitch_m", &L::least_line_pitch_m, "m"},
      {"most_line_pitch_m", &L::most_line_pitch_m, "m"},
      {"most_window_width_m", &L::most_window_width_m, "m"},
      {"most_first_sample_depth_m", &L::most_first_sample_depth_m, "m"},
      {"least_tissue_depth_m", &L::least_tissue_depth_m, "m"},
      {"most_tissue_depth_m", &L::most_tissue_depth_m, "m"},
      {"most_tissue_width_m", &L::most_tissue_width_m, "m"},
      {"least_probe_force_n", &L::least_probe_force_n, "N"},
      {"most_probe_force_n", &L::most_probe_force_n, "N"},
      {"least_probe_elevation_m", &L::least_probe_elevation_m, "m"},
      {"most_probe_elevation_m", &L::most_probe_elevation_m, "m"},
      {"least_max_strain", &L::least_max_strain, "1"},
      {"most_max_strain", &L::most_max_strain, "1"},
      {"least_modulus_time_s", &L::least_modulus_time_s, "s"},
      {"most_modulus_time_s", &L::most_modulus_time_s, "s"},
      {"most_credit", &L::most_credit, "1"},
      {"most_touch_rate_hz", &L::most_touch_rate_hz, "Hz", 20, 1000, "answers of a touch stream"},
      {"least_touch_rate_hz", &L::least_touch_rate_hz, "Hz", 1, 20,
       "answers that a busy service leaves a touch stream that wants more; where it cannot, one more is "
       "refused"},
      {"most_touch_period_s", &L::most_touch_period_s, "s"},
      {"most_finger_rate_hz", &L::most_finger_rate_hz, "Hz"},
      {"most_observe_rate_hz", &L::most_observe_rate_hz, "Hz"},
      {"least_tip_m", &L::least_tip_m, "m"},
      {"most_tip_m", &L::most_tip_m, "m"},
      {"most_touch_streams", &L::most_touch_streams, "1", 1, 4096, "touch streams at once"},
      {"most_watchers", &L::most_watchers, "1", 1, 4096, "watchers of fingers at once"},
      {"most_observers", &L::most_observers, "1", 1, 4096, "observers of scenes at once"},
      {"most_estimates", &L::most_estimates, "1", 1, 256, "uploads and estimates at once"},
      {"most_unary_calls", &L::most_unary_calls, "1", 1, 4096, "other calls at once"},
      {"most_full_scenes", &L::most_full_scenes, "1", 1, 64, "GetScene with maps at once"},
      {"touch_workers", &L::touch_workers, "1", 0, 256,
       "threads that answer touches; 0: as many as cores; at least 2"},
      {"most_threads", &L::most_threads, "1", 16, 4096, "threads of calls"},
      {"first_message_s", &L::first_message_s, "s"},
      {"acknowledge_s", &L::acknowledge_s, "s", 0.1, 600,
       "that an answer or a finger's state waits to be acknowledged"},
      {"answer_taken_s", &L::answer_taken_s, "s"},
      {"touch_idle_s", &L::touch_idle_s, "s", 1, 3600, "silence that ends a touch stream"},
      {"upload_idle_s", &L::upload_idle_s, "s"},
      {"least_upload_s", &L::least_upload_s, "s"},
      {"least_upload_rate", &L::least_upload_rate, "B/s"},
      {"most_finish_within_s", &L::most_finish_within_s, "s"},
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
  if (row == rows.end())
    throw std::invalid_argument(fmt::format("{}: no such limit; GetInfo names them", name));
  if (!row->meaning)
    throw std::invalid_argument(
        fmt::format("{}: it is a constant, {}; take the line out", name, row->value(limits)));
  if (!(value >= row->least && value <= row->most))
    throw std::invalid_argument(fmt::format("{}: {} is not within [{}, {}] {}; it is for {}", name, value,
                                            row->least, row->most, row->unit, row->meaning));
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
