// Reads one frame of recorded RF from a file of any format, depth along the fastest dimension, and judges
// what the file states as it judges the options.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/acquire/recorded_frames.h"
#include "client/acquire/rf_checks.h"

namespace teletact::client {

inline constexpr double kUsualSoundSpeed = 1540;  // m/s, of soft tissue

// One frame as its file gives it.
struct RecordedFrame {
  std::size_t sample_count = 0, line_count = 0;
  std::vector<float> samples;
  RfAxis axis = RfAxis::kFastest;                                  // rf_axis() of them
  teletact::v1::DataType dtype = teletact::v1::DATA_TYPE_FLOAT32;  // of the file
  bool had_offset = false;                                         // RfVerdict's
  std::optional<double> sample_pitch_m, line_pitch_m, first_sample_depth_m, sampling_frequency_hz,
      sound_speed_m_s;
  std::string kind;                 // that the file states, where it is not RF
  std::string made;                 // how, where it is not as in the file
  std::string stamp_s;              // as the file states it
  std::vector<std::string> doubts;  // a line each
};

// Which frame of which file.
struct FrameChoice {
  std::filesystem::path path;
  std::optional<std::size_t> index;
  const char* index_option;  // how messages name it
  std::string variable;
};

// Throws FrameInputError naming the option that helps, and FileError where the file cannot be read.
RecordedFrame read_frame(const FrameChoice& from, const RecordedFrameOptions& options);

// By more than 1 %.
bool differ(double a, double b);

// Throw FrameInputError naming `option`, or what else states the value.
void check_positive(double value, const std::string& option);
void check_hertz(double value, const std::string& option);
void check_sound_speed(double value, const std::string& stated_by);

}  // namespace teletact::client
