// The recorded and simulated RF pairs of ../shared/data, which may not be redistributed: tests that use them
// skip, saying so, only where the folder is absent.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

#include "client/files/metaimage.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

inline std::filesystem::path data_folder() {
  const char* const source = std::getenv("TELETACT_SOURCE_DIR");
  return std::filesystem::path(source ? source : ".") / ".." / "shared" / "data";
}

struct RecordedPair {
  RfFrame pre, post;
  AcquisitionGeometry geometry;
};

inline RfFrame read_frame(const std::filesystem::path& path) {
  const client::MetaImage image = client::read_metaimage(path);
  return {image.size.at(0), image.size.at(1), image.as<float>()};
}

inline RecordedPair read_pair(const std::string& name, double center_frequency_hz,
                              double sampling_frequency_hz, DisplacementFrame frame) {
  RecordedPair pair{
      read_frame(data_folder() / name / "pre.mha"), read_frame(data_folder() / name / "post.mha"), {}};
  pair.geometry.center_frequency_hz = center_frequency_hz;
  pair.geometry.sampling_frequency_hz = sampling_frequency_hz;
  pair.geometry.line_pitch_m = client::read_metaimage(data_folder() / name / "pre.mha").spacing.at(1);
  pair.geometry.frame = frame;
  return pair;
}

inline RecordedPair simulated_inclusion() {
  return read_pair("simulated-inclusion", 8e6, 63.06e6, DisplacementFrame::kLab);
}
inline RecordedPair phantom_s2000() {
  return read_pair("phantom-s2000", 8.9e6, 40e6, DisplacementFrame::kProbe);
}

}  // namespace teletact::service
