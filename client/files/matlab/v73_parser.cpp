#include "client/files/matlab/v73_parser.h"

#include "client/files/matlab/hdf5_reader.h"
#include "client/files/matlab/mat_parser.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

class V73Reader final : Hdf5Reader {
 public:
  V73Reader(const std::filesystem::path& path, std::size_t file_bytes)
      : Hdf5Reader(path, file_bytes, "save it with -v7 or -v7.3") {}

  MatFrames read(const std::string& name, AxialAxis axial) const {
    if (names_in(root()).empty()) refuse("holds no readable variable; the file is empty or damaged");
    const Hdf5Node variable = child(root(), name);
    if (!variable.there()) refuse("has no variable '" + name + "'; it has: " + present());
    require_numeric(variable);
    const Extent extent = extent_of(variable);
    if (extent.rank < 2 || extent.rank > 3)
      refuse_variable(variable,
                      "has " + std::to_string(extent.rank) + " dimensions; save samples x lines [x frames]");
    const std::size_t values = count(variable);
    const auto [rows, columns, pages, none] = extent.size;
    MatFrames out;
    out.sample_count = axial == AxialAxis::kRows ? rows : columns;
    out.line_count = axial == AxialAxis::kRows ? columns : rows;
    out.frame_count = pages;
    std::vector<float> as_written = numbers<float>(variable, values, -1, 0);
    if (axial == AxialAxis::kRows) {
      out.samples = std::move(as_written);
      return out;
    }
    out.samples.resize(values);
    for (std::size_t f = 0; f < pages; ++f)
      for (std::size_t l = 0; l < rows; ++l)
        for (std::size_t k = 0; k < columns; ++k)
          out.samples[k + columns * (l + rows * f)] = as_written[l + rows * (k + columns * f)];
    return out;
  }

 private:
  [[noreturn]] void refuse_variable(const Hdf5Node& variable, const std::string& words) const {
    refuse("variable '" + shown(variable.name) + "' " + words);
  }

  // A class is stated by MATLAB, and by hdf5storage without a NUL at its end; by h5py none.
  void require_numeric(const Hdf5Node& variable) const {
    const std::string kind = text_of(variable, "MATLAB_class");
    if (H5Aexists(variable.id, "MATLAB_sparse") > 0)
      refuse_variable(variable, "is sparse; save full(" + shown(variable.name) + ")");
    if (H5Aexists(variable.id, "MATLAB_empty") > 0)
      refuse_variable(variable, "is empty; choose another variable");
    const Hdf5Id type(variable.is(H5I_DATASET) ? H5Dget_type(variable.id) : H5I_INVALID_HID, H5Tclose);
    const H5T_class_t of_values = type.there() ? H5Tget_class(type) : H5T_NO_CLASS;
    if (of_values == H5T_COMPOUND) refuse_variable(variable, "is complex (IQ?); save real RF samples");
    if ((of_values != H5T_FLOAT && of_values != H5T_INTEGER) || kind == "char" || kind == "cell" ||
        kind == "logical" || kind == "struct" || kind == "function_handle")
      refuse_variable(variable,
                      "cannot be read as numbers (a cell, struct or text); save its RF array as a numeric "
                      "variable of its own, v5 or v7.3");
  }
};

}  // namespace

bool is_hdf5(const std::filesystem::path& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // it would print what we say
  return H5Fis_hdf5(path.c_str()) > 0;
}

MatFrames parse_v73(const std::filesystem::path& path, std::size_t file_bytes, const std::string& variable,
                    AxialAxis axial) {
  return V73Reader(path, file_bytes).read(variable, axial);
}

}  // namespace teletact::client
