// RF frames: files of USTB. In this process, as MATLAB's are (matlab.cpp).
#include <cmath>
#include <fstream>

#include "client/files/matlab/mat_parser.h"
#include "client/files/matlab/uff_parser.h"
#include "tests/fuzzers/client/fuzzers.h"

namespace teletact::fuzzers {

bool uff(Bytes bytes) {
  static const Folder folder;
  const auto path = folder.path() / "fuzzed.uff";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  bool taken = false;
  for (const char* object : {"", "b_data"}) {
    client::UffImage image;
    if (!accepted<client::FileError>([&] { image = client::parse_uff(path, object, 1); })) continue;
    const std::size_t values = image.sample_count * image.line_count;
    require(image.frame_count > 0 && values > 0 && image.values.size() == values,
            "values that do not fill the image");
    require(image.imaginary.empty() || image.imaginary.size() == values, "an imaginary part of another size");
    require(client::can_hold(bytes.size(), static_cast<long double>(values), 1),
            "more than the file can hold");
    require(image.sample_pitch_m > 0 && image.line_pitch_m > 0 && image.first_sample_depth_m >= 0,
            "a geometry that cannot be");
    for (const auto* part : {&image.values, &image.imaginary})
      for (const float value : *part) require(std::isfinite(value), "values that are not finite");
    taken = true;
  }
  return taken;
}

}  // namespace teletact::fuzzers
