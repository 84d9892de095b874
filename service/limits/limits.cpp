#include "service/limits/limits.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>

#include "service/plan/choices.h"

namespace teletact::service {

namespace {

constexpr double kKiB = 1024, kMiB = 1024 * kKiB, kGiB = 1024 * kMiB;

using L = Limits;

}  // namespace

// Ranges end where the numbers behind them were tested, or where a larger value serves nobody. What is least
// and what is most of one thing have ranges that do not overlap, so that any two that are set fit together.
const std::vector<LimitRow>& limit_rows() {
  static const std::vector<LimitRow> rows{
      // Frames first: what a client asks for most.
      {"most_frame_bytes", &L::most_frame_bytes, 64 * kMiB, "B", 64 * kKiB, 256 * kMiB, "one RF frame"},
      {"most_chunk_bytes", &L::most_chunk_bytes, kMiB, "B", kKiB, 16 * kMiB, "one chunk of an upload"},
      {"host_memory_bytes", &L::host_memory_bytes, 0, "B", 0, 1024 * kGiB,
       "memory of the host that may be held; 0: a quarter of it"},
      {"device_memory_bytes", &L::device_memory_bytes, 0, "B", 0, 1024 * kGiB,
       "memory of each device that may be held; 0: half of the smallest one's"},
      {"client_memory_share", &L::client_memory_share, 0.1, "1", 0.001, 1, "part of either for one client"},
      {"most_scenes", &L::most_scenes, 64, "1", 1, 4096, "scenes at once"},
      {"most_scene_elements", &L::most_scene_elements, 65536, "1", 1, 65536,
       "elements of an explicit modulus"},
      {"most_scene_columns", &L::most_scene_columns, 513, "1", 2, 513,
       "nodes of such a scene along x; the work grows with their cube"},
      {"most_solid_elements", &L::most_solid_elements, 400000, "1", 1, 1000000,
       "elements of a solid's explicit modulus"},
      {"most_windows", &L::most_windows, 256, "1", 1, 4096, "windows of a scene"},
      {"least_scene_m", &L::least_scene_m, 0.002, "m", 0.002, 0.02, "least width and depth of a scene"},
      {"most_scene_width_m", &L::most_scene_width_m, 2, "m", 0.02, 2, "width of a scene"},
      {"most_scene_depth_m", &L::most_scene_depth_m, 0.3, "m", 0.02, 0.3, "depth of a scene"},
      {"least_thickness_m", &L::least_thickness_m, 1e-4, "m", 1e-6, 0.01, "out-of-plane width of a contact"},
      {"most_thickness_m", &L::most_thickness_m, 1, "m", 0.01, 10, "out-of-plane width of a contact"},
      {"least_samples", &L::least_samples, 64, "1", 64, 256, "samples of an A-line"},
      {"most_samples", &L::most_samples, 16384, "1", 256, 16384, "samples of an A-line"},
      {"least_lines", &L::least_lines, 8, "1", 8, 32, "A-lines of a frame"},
      {"most_lines", &L::most_lines, 2048, "1", 32, 2048, "A-lines of a frame"},
      {"least_center_frequency_hz", &L::least_center_frequency_hz, 1e5, "Hz", 1e4, 1e6, "centre frequency"},
      {"most_center_frequency_hz", &L::most_center_frequency_hz, 1e8, "Hz", 1e6, 1e9, "centre frequency"},
      {"least_sound_speed_m_s", &L::least_sound_speed_m_s, 1000, "m/s", 1000, 1500, "speed of sound"},
      {"most_sound_speed_m_s", &L::most_sound_speed_m_s, 2500, "m/s", 1500, 2500, "speed of sound"},
      {"least_line_pitch_m", &L::least_line_pitch_m, 1e-5, "m", 1e-5, 1e-4, "distance of A-lines"},
      {"most_line_pitch_m", &L::most_line_pitch_m, 5e-3, "m", 1e-4, 5e-3, "distance of A-lines"},
      {"most_window_width_m", &L::most_window_width_m, 0.5, "m", 0.005, 0.5,
       "A-lines times their distance; the modulus' memory grows with it"},
      {"most_first_sample_depth_m", &L::most_first_sample_depth_m, 0.3, "m", 0, 1,
       "depth of the first sample"},
      {"least_tissue_depth_m", &L::least_tissue_depth_m, 1e-3, "m", 1e-4, 0.01, "stated depth of the tissue"},
      {"most_tissue_depth_m", &L::most_tissue_depth_m, 1, "m", 0.01, 1, "stated depth of the tissue"},
      {"most_tissue_width_m", &L::most_tissue_width_m, 10, "m", 0.5, 10, "stated width of the tissue"},
      {"least_probe_force_n", &L::least_probe_force_n, 1e-6, "N", 1e-9, 0.1, "force of the probe"},
      {"most_probe_force_n", &L::most_probe_force_n, 1e4, "N", 0.1, 1e6, "force of the probe"},
      {"least_probe_elevation_m", &L::least_probe_elevation_m, 1e-4, "m", 1e-6, 1e-3,
       "contact area over the window's width"},
      {"most_probe_elevation_m", &L::most_probe_elevation_m, 0.5, "m", 1e-3, 10,
       "contact area over the window's width"},
      {"least_max_strain", &L::least_max_strain, 1e-3, "1", 1e-4, 0.01, "max_strain that is searched"},
      {"most_max_strain", &L::most_max_strain, 0.125, "1", 0.05, 0.125, "max_strain that is searched"},
      {"least_modulus_time_s", &L::least_modulus_time_s, 1e-3, "s", 1e-6, choices::kModulusTime,
       "modulus_time_limit_s"},
      {"most_modulus_time_s", &L::most_modulus_time_s, 60, "s", choices::kModulusTime, 3600,
       "modulus_time_limit_s"},
      {"most_credit", &L::most_credit, 256, "1", 1, 256, "answers of touch that were not acknowledged"},
      {"most_touch_rate_hz", &L::most_touch_rate_hz, 1000, "Hz", 20, 1000, "answers of a touch stream"},
      {"least_touch_rate_hz", &L::least_touch_rate_hz, 20, "Hz", 1, 20,
       "answers that a busy service leaves a touch stream that wants more; where it cannot, one more is "
       "refused"},
      {"most_touch_period_s", &L::most_touch_period_s, 1, "s", 0.1, 10, "longest period of answers"},
      {"most_finger_rate_hz", &L::most_finger_rate_hz, 100, "Hz", 2, 100,
       "states to a watcher of the finger"},
      {"most_observe_rate_hz", &L::most_observe_rate_hz, 60, "Hz", 2, 100,
       "states to an observer of a scene"},
      {"least_tip_m", &L::least_tip_m, 1e-4, "m", 1e-5, 1e-3, "radius or half width of a fingertip"},
      {"most_tip_m", &L::most_tip_m, 0.014, "m", 1e-3, 0.014,
       "radius or half width of a fingertip; the tissue of a window is fine that far"},
      {"most_touch_streams", &L::most_touch_streams, 512, "1", 1, 4096, "touch streams at once"},
      {"most_watchers", &L::most_watchers, 64, "1", 1, 4096, "watchers of fingers at once"},
      {"most_observers", &L::most_observers, 64, "1", 1, 4096, "observers of scenes at once"},
      {"most_estimates", &L::most_estimates, 8, "1", 1, 256, "uploads and estimates at once"},
      {"most_unary_calls", &L::most_unary_calls, 64, "1", 1, 4096, "other calls at once"},
      {"most_full_scenes", &L::most_full_scenes, 4, "1", 1, 64, "GetScene with maps at once"},
      {"touch_workers", &L::touch_workers, 0, "1", 0, 256,
       "threads that answer touches; 0: as many as cores; at least 2"},
      {"most_threads", &L::most_threads, 256, "1", 16, 4096, "threads of calls"},
      {"first_message_s", &L::first_message_s, 10, "s", 0.1, 600,
       "from opening a stream to its first message"},
      {"acknowledge_s", &L::acknowledge_s, 10, "s", 0.1, 600,
       "that an answer or a finger's state waits to be acknowledged"},
      {"answer_taken_s", &L::answer_taken_s, 10, "s", 0.1, 600,
       "that an answer waits to be taken; a unary call's 1 s more for each MiB"},
      {"touch_idle_s", &L::touch_idle_s, 60, "s", 1, 3600, "silence that ends a touch stream"},
      {"upload_idle_s", &L::upload_idle_s, 10, "s", 0.1, 3600,
       "silence, without a byte, that ends an upload"},
      {"least_upload_s", &L::least_upload_s, 10, "s", 0.1, 3600, "for a whole upload, and beside it"},
      {"least_upload_rate", &L::least_upload_rate, 1e6, "B/s", 1e3, 1e12, "of both frames together"},
      {"most_finish_within_s", &L::most_finish_within_s, 3600, "s", 1, 1e6, "finish_within_s"},
      {"unready_s", &L::unready_s, 0.25, "s", 0, 300,
       "from the signal to stop, all is served on, but the service is not ready: proxies notice"},
      {"move_s", &L::move_s, 10, "s", 0.1, 300,
       "after that, for touches to go to the service that stood by (--standby)"},
      {"drain_s", &L::drain_s, 3, "s", 0.1, 60, "time to end calls when the service is stopped"},
  };
  return rows;
}

double LimitRow::value(const Limits& limits) const {
  return std::visit([&](auto at) { return static_cast<double>(limits.*at); }, member);
}

Limits::Limits() {
  for (const LimitRow& row : limit_rows())
    std::visit([&](auto at) { this->*at = static_cast<std::decay_t<decltype(this->*at)>>(row.usual); },
               row.member);
}

void set_limit(Limits& limits, std::string_view name, double value) {
  const auto& rows = limit_rows();
  const auto row = std::find_if(rows.begin(), rows.end(), [&](const auto& r) { return name == r.name; });
  if (row == rows.end())
    throw std::invalid_argument(fmt::format("{}: no such limit; GetInfo names them", name));
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
