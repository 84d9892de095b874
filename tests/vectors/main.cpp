// teletact-vectors: records what the product does, or compares it with what was recorded.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <limits>

#include "tests/vectors/recorder/record.h"

int main(int argc, char** argv) {
  using namespace teletact::vectors;
  CLI::App app("Records what the product does, or compares it with what was recorded", "teletact-vectors");
  std::string record, compare_with;
  std::size_t max_rows = std::numeric_limits<std::size_t>::max() / 2;
  auto* what = app.add_option_group("what");
  what->add_option("--record", record, "write a recording to this file");
  what->add_option("--compare", compare_with, "compare with this one; exit code 1 beyond tolerance");
  what->require_option(1);
  app.add_option("--rows", max_rows, "keep about so many rows of each vector, and the hash of all")
      ->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  try {
    if (!record.empty()) {
      record_all().write(record, max_rows);
      return 0;
    }
    const Recording before = Recording::read(compare_with);
    std::size_t same = 0, beyond = 0;
    const std::vector<Difference> differences = compare(record_all(), before);
    for (const Difference& d : differences) {
      if (!d.same_bits) std::printf("%s\n", to_string(d).c_str());
      same += d.same_bits;
      beyond += !d.within;
    }
    std::printf("%zu vectors: %zu the same to the bit, %zu beyond tolerance\n", differences.size(), same,
                beyond);
    return beyond == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-vectors: %s\n", error.what());
    return 2;
  }
}
