// Numbers that say what the product does, kept in a file, and their comparison with what it does now.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace teletact::vectors {

// What another machine may make of the same numbers. On one machine, with one compiler and one set of flags,
// all are the same to the bit.
struct Tolerance {
  double relative = 0;  // of a difference, over the largest magnitude in the vector
  double share = 0;     // of the rows, that may differ by more: nodes that are doubtful on one machine alone
};

struct Vector {
  std::string name;            // "touch/layers/force"
  std::size_t components = 1;  // of a row
  std::size_t rows = 0;        // of which each `step`-th is held, from the first on
  std::size_t step = 1;
  std::uint64_t hash = 0;      // FNV-1a of the values of all rows
  std::vector<double> values;  // of the rows held, row after row
  Tolerance tolerance;         // not in the file
};

class Recording {
 public:
  // Appends rows to the vector of that name.
  void append(const std::string& name, std::size_t components, std::span<const double> values,
              const Tolerance&);
  const std::vector<Vector>& vectors() const { return vectors_; }

  // At most `max_rows` rows of each vector, and the hash of all of them. Throws std::runtime_error.
  void write(const std::filesystem::path&, std::size_t max_rows) const;
  static Recording read(const std::filesystem::path&);

 private:
  std::vector<Vector> vectors_;
};

struct Difference {
  std::string name;
  std::string problem;  // one of the two lacks it, or it has another shape; empty: it can be compared
  bool same_bits = false;
  double absolute = 0, relative = 0;  // the largest of the rows held
  double share = 0;                   // of the rows held, beyond the tolerance
  bool within = false;
};

// One for each vector of either, `now` with all rows and its tolerances. A number against none is an infinite
// difference.
std::vector<Difference> compare(const Recording& now, const Recording& before);
std::string to_string(const Difference&);

}  // namespace teletact::vectors
