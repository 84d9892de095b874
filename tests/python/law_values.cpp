// What C++ makes of a contact law, for the Python client's tests: reads pieces as a stream sends them (each
// with its length before it) and poses (three doubles each: x, indentation, z); writes eleven doubles for
// each pose.
#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <optional>

#include "client/link/law_book.h"

int main(int argc, char** argv) {
  using namespace teletact;
  if (argc != 4) {
    std::fprintf(stderr, "usage: teletact-law-values PIECES POSES VALUES\n");
    return 2;
  }
  std::ifstream pieces(argv[1], std::ios::binary), poses(argv[2], std::ios::binary);
  std::ofstream out(argv[3], std::ios::binary);
  google::protobuf::io::IstreamInputStream stream(&pieces);
  client::LawBook book;
  book.open(0);
  for (bool end = false; !end;) {
    v1::LawPiece piece;
    if (google::protobuf::util::ParseDelimitedFromZeroCopyStream(&piece, &stream, &end) &&
        !book.take(piece, 0))
      std::fputs("refused\n", stderr);
  }
  const std::optional<client::NearLaw> law = book.fresh(0);
  for (std::array<double, 3> pose{}; poses.read(reinterpret_cast<char*>(pose.data()), sizeof pose);) {
    const LawValue v = evaluate(law->used(), pose[0], pose[1], pose[2]);
    const std::array<double, 11> row{v.energy_j,        v.by_x_n,         v.by_d_n,
                                     v.by_z_n,          v.error_n,        v.disagreement_n,
                                     double(v.covered), double(v.beyond), double(v.corrected),
                                     double(v.oldest),  double(v.newest)};
    out.write(reinterpret_cast<const char*>(row.data()), sizeof row);
  }
  return out.flush() ? 0 : 1;
}
