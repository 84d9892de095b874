// Every limit of the service that a peer or an operator may meet, in one list: what GetInfo reports, and of
// some what the configuration file may set ([limits] in TOML). What cannot be in nature (nu >= 1/2, a
// negative stiffness) is no limit and stands with the checks.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <variant>
#include <vector>

namespace teletact::service {

struct Limits {
  // Memory. 0 means by the machine: see resolved(). The share is one client's part of either.
  std::uint64_t host_memory_bytes = 0, device_memory_bytes = 0;
  double client_memory_share = 0.1;
  // What a scene may be. Columns are nodes along x: the work grows with their cube. The thickness is a
  // contact's width out of the plane.
  std::uint64_t max_scenes = 64, max_scene_elements = 65536, max_scene_columns = 513,
                max_solid_elements = 400000, max_windows = 256;
  double min_scene_m = 0.002, max_scene_width_m = 2, max_scene_depth_m = 0.3;
  double min_thickness_m = 1e-4, max_thickness_m = 1;
  // What an acquisition may be. The modulus' memory grows with the window's width. The probe's elevation is
  // its contact area over that width.
  std::uint64_t max_frame_bytes = 64 << 20, max_chunk_bytes = 1 << 20;
  std::uint64_t min_samples = 64, max_samples = 16384, min_lines = 8, max_lines = 2048;
  double min_center_frequency_hz = 1e5, max_center_frequency_hz = 1e8;
  double min_sound_speed_m_s = 1000, max_sound_speed_m_s = 2500;
  double min_line_pitch_m = 1e-5, max_line_pitch_m = 5e-3, max_window_width_m = 0.5;
  double max_first_sample_depth_m = 0.3, min_tissue_depth_m = 1e-3, max_tissue_depth_m = 1,
         max_tissue_width_m = 10;
  double min_probe_force_n = 1e-6, max_probe_force_n = 1e4, min_probe_elevation_m = 1e-4,
         max_probe_elevation_m = 0.5;
  double min_max_strain = 1e-3, max_max_strain = 0.125;
  double min_modulus_time_s = 1e-3, max_modulus_time_s = 60;
  // What touch may ask for. The tissue of a window is fine as far as the largest tip reaches.
  std::uint64_t max_credit = 256;
  double max_touch_rate_hz = 1000, min_touch_rate_hz = 20, max_touch_period_s = 1, max_finger_rate_hz = 100,
         max_observe_rate_hz = 60;
  double min_tip_m = 1e-4, max_tip_m = 0.014;
  // Who is served at once, and for how long.
  std::uint64_t max_touch_streams = 512, max_watchers = 64, max_observers = 64, max_estimates = 8,
                max_unary_calls = 64, max_full_scenes = 4;
  std::uint64_t touch_workers = 0, max_threads = 256;
  // From opening a stream to its first message; that an answer waits to be acknowledged, or to be taken (a
  // unary call's 1 s more for each MiB); silence that ends a touch.
  double first_message_s = 10, acknowledge_s = 10, answer_taken_s = 10, touch_idle_s = 60;
  // From the signal to stop: served on, but not ready, until proxies notice; for touches to go to the service
  // that stood by; to end calls.
  double unready_s = 0.25, move_s = 10, drain_s = 3;
  // Silence that ends an upload; for a whole upload so long, and by that rate of both frames (B/s) beside it.
  double upload_idle_s = 10, min_upload_s = 10, min_upload_rate = 1e6, max_finish_within_s = 3600;
};

// One line of the list.
struct LimitRow {
  const char* name;  // as in the configuration and in GetInfo
  std::variant<std::uint64_t Limits::*, double Limits::*> member;
  const char* unit;               // "1" for counts
  double min = 0, max = 0;        // what it may be set to
  const char* meaning = nullptr;  // null: it is a constant
  double value(const Limits&) const;
};

const std::vector<LimitRow>& limit_rows();

// Sets a limit by its name. Throws std::invalid_argument, one line that names it: unknown, a constant,
// outside of its range, not whole where it is a count.
void set_limit(Limits&, std::string_view name, double value);

// Where nothing else was set: the memory budgets as bytes of this machine, a quarter of the host's memory and
// half of the device's; touch workers as many as cores.
Limits resolved(Limits, std::uint64_t host_bytes, std::uint64_t device_bytes);
// Of this machine, or less where this process may have less: the least of its control group and of those that
// it is in (cgroup v2; a container, a unit, a job). `own`: says which group that is, in the folder `groups`.
std::uint64_t host_memory_bytes(const std::filesystem::path& own = "/proc/self/cgroup",
                                const std::filesystem::path& groups = "/sys/fs/cgroup");

}  // namespace teletact::service
