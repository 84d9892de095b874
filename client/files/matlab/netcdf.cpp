#include "client/files/netcdf.h"

#include <hdf5.h>
#include <hdf5_hl.h>

#include <algorithm>
#include <limits>
#include <map>
#include <span>
#include <stdexcept>

#include "client/files/matlab/hdf5_id.h"

namespace teletact::client {

namespace {

constexpr std::size_t kGrowsBy = std::size_t{1} << 20;  // bytes, of the file in memory

// The file is made in memory and written whole by write_file(): HDF5 can fail for want of memory alone.
struct NoRoom {};

template <class T>
T made(T result) {
  if (result < 0) throw NoRoom();
  return result;
}

Hdf5Id text_type(std::size_t bytes) {
  Hdf5Id type(made(H5Tcopy(H5T_C_S1)), H5Tclose);
  made(H5Tset_size(type, bytes));
  made(H5Tset_cset(type, H5T_CSET_UTF8));
  return type;
}

void write_attribute(hid_t object, const char* name, hid_t type, hid_t space, const void* value) {
  const Hdf5Id attribute(made(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT)), H5Aclose);
  if (value != nullptr) made(H5Awrite(attribute, type, value));
}

Hdf5Id row(std::size_t count) {
  const hsize_t n = count;
  return Hdf5Id(made(count == 0 ? H5Screate(H5S_NULL) : H5Screate_simple(1, &n, nullptr)), H5Sclose);
}

void attach(hid_t object, const char* name, const std::string& text) {
  const Hdf5Id type = text_type(std::max<std::size_t>(1, text.size())),
               space(made(H5Screate(text.empty() ? H5S_NULL : H5S_SCALAR)), H5Sclose);
  write_attribute(object, name, type, space, text.empty() ? nullptr : text.data());
}
void attach(hid_t object, const char* name, std::int64_t value) {
  write_attribute(object, name, H5T_STD_I64LE, row(1), &value);
}
void attach(hid_t object, const char* name, const std::vector<double>& values) {
  write_attribute(object, name, H5T_IEEE_F64LE, row(values.size()), values.empty() ? nullptr : values.data());
}
void attach(hid_t object, const char* name, double value) {
  attach(object, name, std::vector<double>{value});
}
void attach(hid_t object, const char* name, const std::vector<std::string>& texts) {
  std::vector<const char*> pointers;
  for (const std::string& text : texts) pointers.push_back(text.c_str());
  write_attribute(object, name, text_type(H5T_VARIABLE), row(texts.size()),
                  texts.empty() ? nullptr : pointers.data());
}

std::string in_words(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

hid_t type_of(const std::vector<float>&) {
  return H5T_IEEE_F32LE;
}
hid_t type_of(const std::vector<std::uint8_t>&) {
  return H5T_STD_U8LE;
}
hid_t type_of(const std::vector<NetcdfFlag>&) {
  static_assert(sizeof(NetcdfFlag) == 1);
  return H5T_STD_I8LE;
}

class Writer {
 public:
  Writer() {
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // it would print what we say
    const Hdf5Id access(made(H5Pcreate(H5P_FILE_ACCESS)), H5Pclose),
        create(made(H5Pcreate(H5P_FILE_CREATE)), H5Pclose);
    made(H5Pset_fapl_core(access, kGrowsBy, false));
    // The order of dimensions and variables is that of their making.
    made(H5Pset_link_creation_order(create, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED));
    made(H5Pset_attr_creation_order(create, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED));
    file_ = Hdf5Id(made(H5Fcreate("in memory", H5F_ACC_TRUNC, create, access)), H5Fclose);
  }

  void add(const NetcdfAxis& axis) {
    std::vector<double> places(axis.count);
    for (std::size_t k = 0; k < axis.count; ++k)
      places[k] = axis.first_m + axis.step_m * static_cast<double>(k);
    const hsize_t n = axis.count;
    Hdf5Id data = dataset(axis.name, H5T_IEEE_F64LE, std::span(&n, 1), places.data());
    made(H5DSset_scale(data, axis.name.c_str()));
    attach(data, "_FillValue", std::numeric_limits<double>::quiet_NaN());
    attach(data, "units", std::string("m"));
    scales_[axis.name] = {std::move(data), axis.count};
  }

  void add(const NetcdfVariable& variable) {
    std::vector<hsize_t> extent;
    std::size_t count = 1;
    for (const std::string& axis : variable.axes) {
      if (!scales_.contains(axis))
        throw std::invalid_argument("NetcdfVariable '" + variable.name + "' lies on '" + axis +
                                    "', which is not an axis");
      extent.push_back(scales_.at(axis).count), count *= scales_.at(axis).count;
    }
    std::visit(
        [&](const auto& values) {
          if (values.size() != count)
            throw std::invalid_argument("NetcdfVariable '" + variable.name + "' does not fit its axes");
          const Hdf5Id data = dataset(variable.name, type_of(values), extent, values.data());
          for (std::size_t k = 0; k < variable.axes.size(); ++k)
            made(H5DSattach_scale(data, scales_.at(variable.axes[k]).id, static_cast<unsigned>(k)));
          mark(data, values);
          attach(data, "long_name", in_words(variable.name));
          attach(data, "units", variable.unit);
        },
        variable.values);
  }

  void add(const std::string& name, const NetcdfAttribute& value) {
    const Hdf5Id root(made(H5Gopen2(file_, "/", H5P_DEFAULT)), H5Gclose);
    std::visit([&](const auto& it) { attach(root, name.c_str(), it); }, value);
  }

  std::string bytes() {
    scales_.clear();  // what is open is not in the image yet
    made(H5Fflush(file_, H5F_SCOPE_GLOBAL));
    std::string out(static_cast<std::size_t>(made(H5Fget_file_image(file_, nullptr, 0))), '\0');
    made(H5Fget_file_image(file_, out.data(), out.size()));
    return out;
  }

 private:
  struct Scale {
    Hdf5Id id;
    std::size_t count = 0;
  };

  Hdf5Id dataset(const std::string& name, hid_t type, std::span<const hsize_t> extent, const void* values) {
    const Hdf5Id space(made(H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr)),
                       H5Sclose),
        create(made(H5Pcreate(H5P_DATASET_CREATE)), H5Pclose);
    made(H5Pset_attr_creation_order(create, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED));
    Hdf5Id data(made(H5Dcreate2(file_, name.c_str(), type, space, H5P_DEFAULT, create, H5P_DEFAULT)),
                H5Dclose);
    made(H5Dwrite(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values));
    return data;
  }

  static void mark(hid_t data, const std::vector<float>&) {
    const float missing = std::numeric_limits<float>::quiet_NaN();
    write_attribute(data, "_FillValue", H5T_IEEE_F32LE, row(1), &missing);
  }
  static void mark(hid_t, const std::vector<std::uint8_t>&) {}
  static void mark(hid_t data, const std::vector<NetcdfFlag>&) { attach(data, "dtype", std::string("bool")); }

  Hdf5Id file_;
  std::map<std::string, Scale> scales_;
};

}  // namespace

bool write_netcdf(const std::filesystem::path& path, const NetcdfContent& content) try {
  Writer writer;
  for (const NetcdfAxis& axis : content.axes) writer.add(axis);
  for (const NetcdfVariable& variable : content.variables) writer.add(variable);
  writer.add("Conventions", std::string("CF-1.8"));
  for (const auto& [name, value] : content.attributes) writer.add(name, value);
  write_file(path, writer.bytes());
  return true;
} catch (const NoRoom&) {
  throw FileError(path, "could not be made: no memory is left for it; free some");
}

}  // namespace teletact::client
