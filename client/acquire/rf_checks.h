// What no file may claim of RF unheard: one policy for all formats. Echoes oscillate along depth, at about
// the centre frequency, about zero; envelopes, pictures and IQ do not, and across the lines nothing does.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace teletact::client {

// A frame as it was read, and what its file or a person says of it.
struct RfStatement {
  std::string file;  // how messages name it
  std::string kind;  // such as "UltrasoundImageType = BRIGHTNESS"; empty: RF, or nothing is said
  double center_frequency_hz = 0, sampling_frequency_hz = 0;
};

enum class RfAxis {
  kFastest,  // samples oscillate along the fastest dimension: it is depth
  kSlowest,  // along the other
  kNeither,  // they do not oscillate at all
  kUnclear   // too few of them, or silence
};

// Along which dimension of `fast` x (samples.size() / fast) the samples oscillate, if `period` of them are
// about one oscillation.
RfAxis rf_axis(const std::vector<float>& samples, std::size_t fast, double period);

// fast x slow -> slow x fast.
std::vector<float> turned(const std::vector<float>& samples, std::size_t fast);

struct RfVerdict {
  std::vector<std::string> doubts;  // a line each, for people
  bool had_offset = false;          // as unsigned samples have it: it was taken off
};

// Depth is the fastest of `line_count` lines by now; `axis` is rf_axis() of them. Throws FrameInputError for
// what cannot be RF: NaN, an envelope, a picture, IQ, too few samples in a period.
RfVerdict check_rf(std::vector<float>& samples, std::size_t line_count, RfAxis axis, const RfStatement& said);

// Of lengths that contradict each other: one line for each.
struct RfLengths {
  std::string file;
  double sample_pitch_m = 0, line_pitch_m = 0, width_m = 0;
  double contact_area_m2 = 0, probe_elevation_m = 0;  // 0: not stated
};
std::vector<std::string> doubtful_lengths(const RfLengths&);

}  // namespace teletact::client
