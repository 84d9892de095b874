#include "client/files/matlab/mat_parser.h"

#include <matio.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <new>
#include <string_view>

#include "client/files/matlab/v5_elements.h"
#include "client/files/matlab/v73_parser.h"
#include "client/text/shown.h"

namespace teletact::client {

namespace {

// deflate cannot shrink by more than about 1032: what claims more is a damaged header, refused unallocated.
constexpr long double kLargestCompression = 1100;
constexpr std::size_t kLargestValues = std::size_t{1} << 30;
constexpr std::size_t kMaxNamed = 500;  // bytes of the names of what is there

// matio and HDF5 keep global state; files are read one at a time.
std::mutex matio_mutex;
// Guarded by matio_mutex. Made when it is asked for: parsers work before this program's other objects are
// made.
std::string& matio_complaint() {
  static std::string complaint;
  return complaint;
}

template <class Text>  // char in matio 1.5.23, const char in 1.5.28
void keep_complaint(int level, Text* message) {
  if (level <= MATIO_LOG_LEVEL_WARNING) matio_complaint() = message;
}

struct CloseMat {
  void operator()(mat_t* mat) const { Mat_Close(mat); }
};
struct FreeVariable {
  void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};
using Mat = std::unique_ptr<mat_t, CloseMat>;
using Variable = std::unique_ptr<matvar_t, FreeVariable>;

std::string names_in(mat_t* mat) {
  std::size_t count = 0;
  char* const* names = Mat_GetDir(mat, &count);
  std::string list;
  for (std::size_t i = 0; names != nullptr && i < count; ++i)
    if (names[i] != nullptr) list += (list.empty() ? "" : ", ") + shown(names[i]);
  return shown(list, kMaxNamed);
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
        path,
        prefix +
            "cannot be read as numbers (a cell, struct or text); save its RF array as a numeric variable "
            "of its own, v5 or v7.3");
  if (info.isComplex != 0) throw FileError(path, prefix + "is complex (IQ?); save real RF samples");
  if (info.rank < 2 || info.rank > 3)
    throw FileError(
        path, prefix + "has " + std::to_string(info.rank) + " dimensions; save samples x lines [x frames]");
  std::vector<std::size_t> dims(info.dims, info.dims + info.rank);
  dims.resize(3, 1);
  long double values = 1;
  for (const std::size_t n : dims) values *= static_cast<long double>(n);
  if (values < 1) throw FileError(path, prefix + "is empty; choose another variable");
  if (!can_hold(file_bytes, values, Mat_SizeOfClass(info.class_type)))
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

bool can_hold(std::size_t file_bytes, long double values, std::size_t value_bytes) {
  return values <= static_cast<long double>(kLargestValues) &&
         values * static_cast<long double>(value_bytes) <=
             kLargestCompression * static_cast<long double>(file_bytes);
}

MatFrames parse_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial) {
  const std::size_t file_bytes = readable_file_size(path);
  require_whole_v5(path, file_bytes, variable);
  const std::lock_guard lock(matio_mutex);
  // matio would read MATLAB's own alone, not those of hdf5storage or h5py.
  if (is_hdf5(path)) return parse_v73(path, file_bytes, variable, axial);
  Mat_LogInitFunc("teletact", keep_complaint);
  matio_complaint().clear();
  const Mat mat(Mat_Open(path.c_str(), MAT_ACC_RDONLY));
  if (!mat) throw FileError(path, "is not a MATLAB file or is damaged; save it with -v7 or -v7.3");
  if (Mat_GetVersion(mat.get()) == MAT_FT_MAT4)
    throw FileError(path, "is of MATLAB version 4 or damaged; save it with -v7 or -v7.3");
  const Variable read(Mat_VarReadInfo(mat.get(), variable.c_str()));
  if (!read) {
    const std::string present = names_in(mat.get());
    if (present.empty()) throw FileError(path, "holds no readable variable; the file is empty or damaged");
    throw FileError(path, "has no variable '" + variable + "'; it has: " + present);
  }
  const auto dims = checked_dimensions(path, variable, *read, file_bytes);
  MatFrames out;
  out.samples.resize(dims[0] * dims[1] * dims[2]);
  const std::size_t expected = out.samples.size() * Mat_SizeOfClass(read->class_type);
  ::operator delete(::operator new(expected));  // what does not fit is said here: matio calls it damaged
  matio_complaint().clear();
  const int failed = Mat_VarReadDataAll(mat.get(), read.get());
  if (failed != 0 || read->data == nullptr || !matio_complaint().empty() || read->nbytes != expected)
    throw FileError(path, "variable '" + variable +
                              "' cannot be read; the file is truncated or damaged: export it again");
  out.sample_count = axial == AxialAxis::kRows ? dims[0] : dims[1];
  out.line_count = axial == AxialAxis::kRows ? dims[1] : dims[0];
  out.frame_count = dims[2];
  gather_any(*read, axial, dims[0], dims[1], out);
  return out;
}

}  // namespace teletact::client
