// RF frames: files of MATLAB, v5 to v7.3. In this process: what crashes within matio or HDF5 is contained by
// parse_mat_apart(), and shown by a test of that.
#include "client/files/matlab/mat_parser.h"

#include <fstream>

#include "tests/fuzzers/client/fuzzers.h"

namespace teletact::fuzzers {

bool matlab(Bytes bytes) {
  static const Folder folder;  // HDF5 takes no file in memory: it asks for the path behind a link
  const auto path = folder.path() / "fuzzed.mat";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  bool taken = false;
  for (const auto axis : {client::AxialAxis::kRows, client::AxialAxis::kColumns}) {
    client::MatFrames frames;
    if (!accepted<client::FileError>([&] { frames = client::parse_mat(path, "rf", axis); })) continue;
    const std::size_t values = frames.sample_count * frames.line_count * frames.frame_count;
    require(values > 0 && frames.samples.size() == values, "samples that do not fill the frames");
    require(client::can_hold(bytes.size(), static_cast<long double>(values), 1),
            "more than the file can hold");
    taken = true;
  }
  return taken;
}

}  // namespace teletact::fuzzers
