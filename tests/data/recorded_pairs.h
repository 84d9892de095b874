// The recorded and simulated RF pairs of ../shared/data, which may not be redistributed: tests that use them
// skip, saying so, only where the folder is absent.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "client/files/metaimage.h"
#include "service/imaging/estimate.h"
#include "service/imaging/tracking/frame.h"

#define SKIP_WITHOUT_DATA(name)                                                                 \
  if (!std::filesystem::exists(data_folder() / name)) {                                         \
    std::printf("SKIPPED: no %s\n", (data_folder() / name).c_str());                            \
    GTEST_SKIP() << "no " << (data_folder() / name) << ": these data may not be redistributed"; \
  }

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

inline double x_of(const Estimate& e, std::size_t n) {
  return e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m;
}
inline double y_of(const Estimate& e, std::size_t n) {
  return e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m;
}

}  // namespace teletact::service
