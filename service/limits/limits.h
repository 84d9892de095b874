// Every limit of the service that a peer or an operator may meet, in one list. From it come the defaults,
// what the configuration file may set ([limits] in TOML), and what GetInfo reports. What cannot be in nature
// (nu >= 1/2, a negative stiffness) is no limit and stands with the checks.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <variant>
#include <vector>

namespace teletact::service {

struct Limits {
  // Memory. 0 means by the machine: see resolved().
  std::uint64_t host_memory_bytes, device_memory_bytes;
  double client_memory_share;
  // What a scene may be.
  std::uint64_t most_scenes, most_scene_elements, most_scene_columns, most_solid_elements, most_windows;
  double least_scene_m, most_scene_width_m, most_scene_depth_m;
  double least_thickness_m, most_thickness_m;
  // What an acquisition may be.
  std::uint64_t most_frame_bytes, most_chunk_bytes;
  std::uint64_t least_samples, most_samples, least_lines, most_lines;
  double least_center_frequency_hz, most_center_frequency_hz;
  double least_sound_speed_m_s, most_sound_speed_m_s;
  double least_line_pitch_m, most_line_pitch_m, most_window_width_m;
  double most_first_sample_depth_m, least_tissue_depth_m, most_tissue_depth_m, most_tissue_width_m;
  double least_probe_force_n, most_probe_force_n, least_probe_elevation_m, most_probe_elevation_m;
  double least_max_strain, most_max_strain;
  double least_modulus_time_s, most_modulus_time_s;
  // What touch may ask for.
  std::uint64_t most_credit;
  double most_touch_rate_hz, least_touch_rate_hz, most_touch_period_s, most_finger_rate_hz,
      most_observe_rate_hz;
  double least_tip_m, most_tip_m;
  // Who is served at once, and for how long.
  std::uint64_t most_touch_streams, most_watchers, most_observers, most_estimates, most_unary_calls,
      most_full_scenes;
  std::uint64_t touch_workers, most_threads;
  double first_message_s, acknowledge_s, answer_taken_s, touch_idle_s;
  double unready_s, move_s, drain_s;
  double upload_idle_s, least_upload_s, least_upload_rate, most_finish_within_s;

  Limits();  // the defaults
};

// One line of the list.
struct LimitRow {
  const char* name;  // as in the configuration and in GetInfo
  std::variant<std::uint64_t Limits::*, double Limits::*> member;
  double usual;        // the default
  const char* unit;    // "1" for counts
  double least, most;  // what it may be set to
  const char* meaning;
  double value(const Limits&) const;
};

const std::vector<LimitRow>& limit_rows();

// Sets a limit by its name. Throws std::invalid_argument, one line that names it: unknown, outside of its
// range, not whole where it is a count.
void set_limit(Limits&, std::string_view name, double value);

// Where nothing else was set: the memory budgets as bytes of this machine, a quarter of the host's memory and
// half of the device's; touch workers as many as cores.
Limits resolved(Limits, std::uint64_t host_bytes, std::uint64_t device_bytes);
// Of this machine, or less where this process may have less: the least of its control group and of those that
// it is in (cgroup v2; a container, a unit, a job). `own`: says which group that is, in the folder `groups`.
std::uint64_t host_memory_bytes(const std::filesystem::path& own = "/proc/self/cgroup",
                                const std::filesystem::path& groups = "/sys/fs/cgroup");

}  // namespace teletact::service
