// Parts of an HDF5 file by their names: checked before they are read, and none that lies in another file.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "client/files/matlab/hdf5_id.h"

namespace teletact::client {

// An object of the file, and how messages name it.
struct Hdf5Node {
  Hdf5Id id;
  std::string name;
  bool there() const { return id.there(); }
  bool is(H5I_type_t type) const { return there() && H5Iget_type(id) == type; }
};

// Follows no link, soft or external.
Hdf5Node child(const Hdf5Node& parent, const std::string& name);
// "" where there is none that is a short text.
std::string text_of(const Hdf5Node& node, const char* attribute);
std::vector<std::string> names_in(const Hdf5Node& group);
// For messages.
std::string listed(const std::vector<std::string>& names);

// What refuses throws FileError.
class Hdf5Reader {
 public:
  // `remedy`: for what is no HDF5 file.
  Hdf5Reader(const std::filesystem::path& path, std::size_t file_bytes, const std::string& remedy);

  static constexpr std::size_t kMaxRank = 4;
  // Sizes of an array of numbers, the fastest first, as MATLAB has them; those after the last are 1.
  struct Extent {
    std::array<std::size_t, kMaxRank> size{1, 1, 1, 1};
    std::size_t rank = 0;  // 0: one number
  };

 protected:
  [[noreturn]] void refuse(const std::string& words) const;
  [[noreturn]] void refuse_field(const Hdf5Node& field, const std::string& words) const;
  [[noreturn]] void refuse_larger(const Hdf5Node& field) const;
  const Hdf5Node& root() const { return root_; }
  std::string present() const;  // names of what is there
  Extent extent_of(const Hdf5Node& data) const;
  // How many numbers there are, all dimensions together: at least one.
  std::size_t count(const Hdf5Node& data) const;
  // Refuses where the file cannot hold so many values.
  void require_held(const Hdf5Node& data, long double values) const;
  // Frame `frame` of an array: dimension `along` (counted as in HDF5, the slowest first) at that place.
  // All of it where `along` is negative. Throws where there are not `values` of them.
  template <class T>
  std::vector<T> numbers(const Hdf5Node& data, std::size_t values, int along, std::size_t frame) const;

 private:
  void read(const Hdf5Node& data, std::size_t values, int along, std::size_t frame, hid_t type,
            void* into) const;
  const std::filesystem::path path_;
  const std::size_t file_bytes_;
  const Hdf5Id file_;
  Hdf5Node root_{Hdf5Id(), ""};
};

template <class T>
std::vector<T> Hdf5Reader::numbers(const Hdf5Node& data, std::size_t values, int along,
                                   std::size_t frame) const {
  std::vector<T> out(values);
  read(data, values, along, frame, sizeof(T) == sizeof(float) ? H5T_NATIVE_FLOAT : H5T_NATIVE_DOUBLE,
       out.data());
  return out;
}

}  // namespace teletact::client
