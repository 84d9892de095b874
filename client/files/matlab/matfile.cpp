#include "client/files/matfile.h"

#include <matio.h>

#include <array>
#include <cstdint>
#include <fstream>
#include <memory>
#include <mutex>
#include <string_view>

namespace teletact::client {

namespace {

// deflate cannot shrink by more than about 1032: what claims more is a damaged header, refused unallocated.
constexpr long double kLargestCompression = 1100;
constexpr std::size_t kLargestValues = std::size_t{1} << 30;

// matio and HDF5 keep global state; files are read one at a time.
std::mutex matio_mutex;
std::string matio_complaint;  // guarded by matio_mutex

void keep_complaint(int level, char* message) {
  if (level <= MATIO_LOG_LEVEL_WARNING) matio_complaint = message;
}

struct CloseMat {
  void operator()(mat_t* mat) const { Mat_Close(mat); }
};
struct FreeVariable {
  void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};
using Mat = std::unique_ptr<mat_t, CloseMat>;
using Variable = std::unique_ptr<matvar_t, FreeVariable>;

// matio fills what a truncated v5 file lacks with whatever lay in memory and reports success, so the chain of
// top-level elements (128-byte header, then tags of type and size) is walked here first: it must end where
// the file ends.
void refuse_truncated_v5(const std::filesystem::path& path, std::size_t file_bytes) {
  std::ifstream in(path, std::ios::binary);
  std::array<char, 128> head{};
  in.read(head.data(), head.size());
  // The text before is free; bytes 124 to 127 hold version 0x0100 and the letters of the byte order. v7.3 is
  // 0x0200: HDF5 checks its own length.
  const bool swapped = head[126] == 'M' && head[127] == 'I';
  const bool v5 = swapped ? head[124] == 1 && head[125] == 0 : head[124] == 0 && head[125] == 1;
  if (!in || !v5) return;
  std::uint64_t at = head.size();
  while (at < file_bytes) {
    std::array<std::uint32_t, 2> tag{};
    in.seekg(static_cast<std::streamoff>(at));
    in.read(reinterpret_cast<char*>(tag.data()), sizeof tag);
    if (!in) break;
    at += sizeof tag + (swapped ? __builtin_bswap32(tag[1]) : tag[1]);
  }
  if (at != file_bytes) throw FileError(path, "is truncated or damaged; copy or export it again");
}

std::string names_in(mat_t* mat) {
  std::size_t count = 0;
  char** names = Mat_GetDir(mat, &count);
  std::string list;
  for (std::size_t i = 0; names != nullptr && i < count; ++i)
    if (names[i] != nullptr) list += (list.empty() ? "" : ", ") + std::string(names[i]);
  return list;
}

bool is_numeric(matio_classes c) {
  switch (c) {
    case MAT_C_DOUBLE:
    case MAT_C_SINGLE:
    case MAT_C_INT8:
    case MAT_C_UINT8:
    case MAT_C_INT16:
    case MAT_C_UINT16:
    case MAT_C_INT32:
    case MAT_C_UINT32:
    case MAT_C_INT64:
    case MAT_C_UINT64:
      return true;
    default:
      return false;
  }
}

// Checks kind and size before the data are read. Returns rows, columns, pages.
std::vector<std::size_t> checked_dimensions(const std::filesystem::path& path, const std::string& name,
                                            const matvar_t& info, std::size_t file_bytes) {
  const std::string prefix = "variable '" + name + "' ";
  if (info.class_type == MAT_C_SPARSE) throw FileError(path, prefix + "is sparse; save full(" + name + ")");
  if (!is_numeric(info.class_type))
    throw FileError(
        path, prefix +
                  "cannot be read as numbers (a cell, struct or text, or a v7.3 file whose MATLAB_class is "
                  "not as MATLAB writes it); save its RF array as a numeric variable of its own, v5 or v7.3");
  if (info.isComplex != 0) throw FileError(path, prefix + "is complex (IQ?); save real RF samples");
  if (info.rank < 2 || info.rank > 3)
    throw FileError(
        path, prefix + "has " + std::to_string(info.rank) + " dimensions; save samples x lines [x frames]");
  std::vector<std::size_t> dims(info.dims, info.dims + info.rank);
  dims.resize(3, 1);
  long double values = 1;
  for (const std::size_t n : dims) values *= static_cast<long double>(n);
  if (values < 1) throw FileError(path, prefix + "is empty; choose another variable");
  const long double bytes = values * static_cast<long double>(Mat_SizeOfClass(info.class_type));
  if (bytes > kLargestCompression * static_cast<long double>(file_bytes) ||
      values > static_cast<long double>(kLargestValues))
    throw FileError(
        path, prefix + "claims to be larger than the file can hold; the file is damaged: export it again");
  return dims;
}

template <class T>
void gather(const matvar_t& variable, AxialAxis axial, std::size_t rows, std::size_t columns,
            MatFrames& out) {
  const T* in = static_cast<const T*>(variable.data);
  const std::size_t page = rows * columns;
  for (std::size_t f = 0; f < out.frame_count; ++f)
    for (std::size_t l = 0; l < out.line_count; ++l)
      for (std::size_t k = 0; k < out.sample_count; ++k) {
        const std::size_t from = axial == AxialAxis::kRows ? k + rows * l : l + rows * k;
        out.samples[k + out.sample_count * (l + out.line_count * f)] =
            static_cast<float>(in[f * page + from]);
      }
}

void gather_any(const matvar_t& v, AxialAxis axial, std::size_t rows, std::size_t columns, MatFrames& out) {
  switch (v.class_type) {
    case MAT_C_DOUBLE:
      return gather<double>(v, axial, rows, columns, out);
    case MAT_C_SINGLE:
      return gather<float>(v, axial, rows, columns, out);
    case MAT_C_INT8:
      return gather<std::int8_t>(v, axial, rows, columns, out);
    case MAT_C_UINT8:
      return gather<std::uint8_t>(v, axial, rows, columns, out);
    case MAT_C_INT16:
      return gather<std::int16_t>(v, axial, rows, columns, out);
    case MAT_C_UINT16:
      return gather<std::uint16_t>(v, axial, rows, columns, out);
    case MAT_C_INT32:
      return gather<std::int32_t>(v, axial, rows, columns, out);
    case MAT_C_UINT32:
      return gather<std::uint32_t>(v, axial, rows, columns, out);
    case MAT_C_INT64:
      return gather<std::int64_t>(v, axial, rows, columns, out);
    default:
      return gather<std::uint64_t>(v, axial, rows, columns, out);
  }
}

}  // namespace

MatFrames read_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial) {
  const std::size_t file_bytes = readable_file_size(path);
  refuse_truncated_v5(path, file_bytes);
  const std::lock_guard lock(matio_mutex);
  Mat_LogInitFunc("teletact", keep_complaint);
  matio_complaint.clear();
  const Mat mat(Mat_Open(path.c_str(), MAT_ACC_RDONLY));
  if (!mat) throw FileError(path, "is no MATLAB file or is damaged; save it with -v7 or -v7.3");
  if (Mat_GetVersion(mat.get()) == MAT_FT_MAT4)
    throw FileError(path, "is of MATLAB version 4 or damaged; save it with -v7 or -v7.3");
  const Variable read(Mat_VarReadInfo(mat.get(), variable.c_str()));
  if (!read) {
    const std::string present = names_in(mat.get());
    if (present.empty()) throw FileError(path, "holds no readable variable; the file is empty or damaged");
    throw FileError(path, "has no variable '" + variable + "'; it has: " + present);
  }
  const auto dims = checked_dimensions(path, variable, *read, file_bytes);
  matio_complaint.clear();
  const int failed = Mat_VarReadDataAll(mat.get(), read.get());
  const std::size_t expected = dims[0] * dims[1] * dims[2] * Mat_SizeOfClass(read->class_type);
  if (failed != 0 || read->data == nullptr || !matio_complaint.empty() || read->nbytes != expected)
    throw FileError(path, "variable '" + variable +
                              "' cannot be read; the file is truncated or damaged: export it again");
  MatFrames out;
  out.sample_count = axial == AxialAxis::kRows ? dims[0] : dims[1];
  out.line_count = axial == AxialAxis::kRows ? dims[1] : dims[0];
  out.frame_count = dims[2];
  out.samples.resize(dims[0] * dims[1] * dims[2]);
  gather_any(*read, axial, dims[0], dims[1], out);
  return out;
}

}  // namespace teletact::client
