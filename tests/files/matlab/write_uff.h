// Files of USTB as its uff.write_object makes them, and such as it would not make: by HDF5's own calls.
#pragma once

#include <gtest/gtest.h>
#include <hdf5.h>

#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

namespace teletact::client {

class UffFile {
 public:
  explicit UffFile(const std::filesystem::path& path)
      : id(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) {
    EXPECT_GE(id, 0) << path;
  }
  ~UffFile() { H5Fclose(id); }
  UffFile(const UffFile&) = delete;
  UffFile& operator=(const UffFile&) = delete;

  // A text of fixed length, as MATLAB writes it; or of variable length, as Python does.
  void text(const std::string& at, const char* name, const std::string& value, bool variable = false) {
    const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR),
                object = H5Oopen(id, at.c_str(), H5P_DEFAULT);
    H5Tset_size(type, variable ? H5T_VARIABLE : value.size());
    const hid_t attribute = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    const char* pointer = value.c_str();
    EXPECT_GE(H5Awrite(attribute, type, variable ? static_cast<const void*>(&pointer) : pointer), 0);
    H5Aclose(attribute), H5Oclose(object), H5Sclose(space), H5Tclose(type);
  }
  void flag(const std::string& at, const char* name, double value) {
    const hsize_t one = 1;
    const hid_t space = H5Screate_simple(1, &one, nullptr), object = H5Oopen(id, at.c_str(), H5P_DEFAULT);
    const hid_t attribute = H5Acreate2(object, name, H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, H5P_DEFAULT);
    EXPECT_GE(H5Awrite(attribute, H5T_NATIVE_DOUBLE, &value), 0);
    H5Aclose(attribute), H5Oclose(object), H5Sclose(space);
  }
  void group(const std::string& at, const std::string& kind, bool array = false) {
    H5Gclose(H5Gcreate2(id, at.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    if (kind.empty()) return;
    text(at, "class", kind);
    flag(at, "array", array);
  }
  // `extent`: the slowest first, so MATLAB's the other way round.
  void numbers(const std::string& at, const std::vector<hsize_t>& extent, const std::vector<float>& values,
               hid_t made = H5P_DEFAULT) {
    const hid_t space = H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr);
    const hid_t data = H5Dcreate2(id, at.c_str(), H5T_IEEE_F32LE, space, H5P_DEFAULT, made, H5P_DEFAULT);
    EXPECT_GE(data, 0) << at;
    if (!values.empty()) {
      EXPECT_GE(H5Dwrite(data, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0) << at;
    }
    H5Dclose(data), H5Sclose(space);
  }
  void number(const std::string& at, double value) { numbers(at, {1, 1}, {static_cast<float>(value)}); }
  void axis(const std::string& at, double first, double step, std::size_t count) {
    std::vector<float> places(count);
    for (std::size_t k = 0; k < count; ++k)
      places[k] = static_cast<float>(first + step * static_cast<double>(k));
    numbers(at, {1, count}, places);
  }
  void remove(const std::string& at) { EXPECT_GE(H5Ldelete(id, at.c_str(), H5P_DEFAULT), 0) << at; }

  const hid_t id;
};

struct UffScan {
  std::size_t lines, samples;
  double line_pitch_m, sample_pitch_m, first_depth_m;
};

// An object of frames, of which each has `lines` times `samples` values, axial fastest; real where
// `imaginary` is empty.
inline void write_beamformed(UffFile& file, const std::string& at, const UffScan& scan,
                             const std::vector<float>& values, const std::vector<float>& imaginary) {
  const std::size_t pixels = scan.lines * scan.samples;
  const std::size_t frames = values.size() / pixels;
  const std::vector<hsize_t> extent =
      frames == 1 ? std::vector<hsize_t>{1, pixels} : std::vector<hsize_t>{frames, 1, 1, pixels};
  file.group(at, "uff.beamformed_data");
  file.group(at + "/scan", "uff.linear_scan");
  file.axis(at + "/scan/x_axis", 0, scan.line_pitch_m, scan.lines);
  file.axis(at + "/scan/z_axis", scan.first_depth_m, scan.sample_pitch_m, scan.samples);
  if (imaginary.empty()) {
    file.numbers(at + "/data", extent, values);
    return;
  }
  file.group(at + "/data", "single");
  file.numbers(at + "/data/real", extent, values);
  file.numbers(at + "/data/imag", extent, imaginary);
}

}  // namespace teletact::client
