#include "client/files/matlab/hdf5_reader.h"

#include <fstream>
#include <new>
#include <string_view>

#include "client/files/file_io.h"
#include "client/files/matlab/mat_parser.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

constexpr std::size_t kMaxListed = 500;    // bytes of names
constexpr std::size_t kMaxObjects = 1000;  // of a file
constexpr std::size_t kMaxText = 256;      // bytes

// Whether its superblock says that a writer has it open: so it stays when that writer crashes.
bool was_not_closed(const std::filesystem::path& path, std::size_t file_bytes) {
  constexpr std::size_t kVersionAt = 8, kFlagsAt = 11, kBytes = 12;
  constexpr int kOpenForWriting = 1, kOpenForSwmr = 4, kFirstWithFlags = 3;
  std::ifstream in(path, std::ios::binary);
  for (std::size_t at = 0; at + kBytes <= file_bytes; at = at == 0 ? 512 : 2 * at) {  // where HDF5 looks
    std::array<char, kBytes> block{};
    in.seekg(static_cast<std::streamoff>(at));
    in.read(block.data(), block.size());
    if (!std::string_view(block.data(), block.size()).starts_with("\x89HDF\r\n\x1a\n")) continue;
    return block[kVersionAt] >= kFirstWithFlags && (block[kFlagsAt] & (kOpenForWriting | kOpenForSwmr)) != 0;
  }
  return false;
}

// The name of a filter that packed the array and is not here, or "".
std::string missing_filter(hid_t data) {
  const Hdf5Id made(H5Dget_create_plist(data), H5Pclose);
  const int filters = H5Pget_nfilters(made);
  for (int k = 0; k < filters; ++k) {
    unsigned flags = 0, settings = 0;
    std::size_t values = 0;
    std::array<char, kMaxText> name{};
    const H5Z_filter_t filter = H5Pget_filter2(made, static_cast<unsigned>(k), &flags, &values, nullptr,
                                               name.size() - 1, name.data(), &settings);
    if (filter >= 0 && H5Zfilter_avail(filter) <= 0)
      return name[0] != '\0' ? shown(name.data()) : std::to_string(filter);
  }
  return "";
}

}  // namespace

Hdf5Node child(const Hdf5Node& parent, const std::string& name) {
  Hdf5Node out{Hdf5Id(), parent.name.empty() ? name : parent.name + "/" + name};
  H5L_info_t link{};
  // Soft links need not be followed, and external ones must not be.
  if (!parent.is(H5I_GROUP) || name.empty() || H5Lexists(parent.id, name.c_str(), H5P_DEFAULT) <= 0 ||
      H5Lget_info(parent.id, name.c_str(), &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD)
    return out;
  out.id = Hdf5Id(H5Oopen(parent.id, name.c_str(), H5P_DEFAULT), H5Oclose);
  return out;
}

std::string text_of(const Hdf5Node& node, const char* attribute) {
  if (H5Aexists(node.id, attribute) <= 0) return "";
  const Hdf5Id read(H5Aopen(node.id, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Id type(read.there() ? H5Aget_type(read) : H5I_INVALID_HID, H5Tclose);
  const Hdf5Id space(read.there() ? H5Aget_space(read) : H5I_INVALID_HID, H5Sclose);
  if (!type.there() || H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(space) != 1)
    return "";
  if (H5Tis_variable_str(type) > 0) {
    char* text = nullptr;
    if (H5Aread(read, type, static_cast<void*>(&text)) < 0 || text == nullptr) return "";
    std::string out(std::string_view(text).substr(0, kMaxText));
    H5free_memory(text);
    return out;
  }
  const std::size_t bytes = H5Tget_size(type);
  if (bytes == 0 || bytes > kMaxText) return "";
  std::string out(bytes, '\0');  // with or without a NUL at its end
  if (H5Aread(read, type, out.data()) < 0) return "";
  return out.c_str();
}

std::vector<std::string> names_in(const Hdf5Node& group) {
  std::vector<std::string> names;
  const auto add = [](hid_t, const char* name, const H5L_info_t*, void* into) -> herr_t {
    auto& all = *static_cast<std::vector<std::string>*>(into);
    if (all.size() == kMaxObjects) return 1;
    try {
      all.emplace_back(name);
    } catch (const std::bad_alloc&) {
      return -1;
    }
    return 0;
  };
  H5Literate(group.id, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names);
  return names;
}

std::string listed(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + shown(name);
  return shown(list, kMaxListed);
}

Hdf5Reader::Hdf5Reader(const std::filesystem::path& path, std::size_t file_bytes, const std::string& remedy)
    : path_(path),
      file_bytes_(file_bytes),
      file_((H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr),  // it would print what we say
             H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT)),
            H5Fclose) {
  if (!file_.there() && was_not_closed(path, file_bytes))
    refuse("was not closed by the program that wrote it; close it there, or clear its mark: h5clear -s FILE");
  if (!file_.there()) refuse("is not an HDF5 file or is damaged; " + remedy);
  root_.id = Hdf5Id(H5Gopen2(file_, "/", H5P_DEFAULT), H5Gclose);
}

void Hdf5Reader::refuse(const std::string& words) const {
  throw FileError(path_, words);
}

void Hdf5Reader::refuse_field(const Hdf5Node& field, const std::string& words) const {
  refuse("'" + shown(field.name) + "' " + words);
}

void Hdf5Reader::refuse_larger(const Hdf5Node& field) const {
  refuse_field(field, "claims to be larger than the file can hold; the file is damaged: write it again");
}

std::string Hdf5Reader::present() const {
  const std::vector<std::string> names = names_in(root_);
  return names.empty() ? "nothing" : listed(names);
}

Hdf5Reader::Extent Hdf5Reader::extent_of(const Hdf5Node& data) const {
  if (!data.is(H5I_DATASET)) refuse_field(data, "is missing or not an array; write the object again");
  const Hdf5Id type(H5Dget_type(data.id), H5Tclose), space(H5Dget_space(data.id), H5Sclose),
      made(H5Dget_create_plist(data.id), H5Pclose);
  if (!type.there() || (H5Tget_class(type) != H5T_FLOAT && H5Tget_class(type) != H5T_INTEGER) ||
      H5Tget_size(type) > sizeof(double))
    refuse_field(data, "holds no real numbers; write the object again");
  if (H5Pget_layout(made) == H5D_VIRTUAL || H5Pget_external_count(made) != 0)
    refuse_field(data, "lies in another file; write it into this one");
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0 || rank > static_cast<int>(kMaxRank) || H5Sget_simple_extent_type(space) == H5S_NULL)
    refuse_field(data,
                 "has " + std::to_string(rank) + " dimensions; at most pixels, channels, waves, frames");
  Extent out;
  out.rank = static_cast<std::size_t>(rank);
  std::array<hsize_t, kMaxRank> extent{};
  H5Sget_simple_extent_dims(space, extent.data(), nullptr);
  for (std::size_t k = 0; k < out.rank; ++k) out.size[k] = extent[out.rank - 1 - k];
  long double bytes = static_cast<long double>(H5Tget_size(type));
  for (const std::size_t n : out.size) bytes *= static_cast<long double>(n);
  // HDF5 reads what it was not given. What is packed may be larger than the file.
  if (H5Pget_layout(made) != H5D_CHUNKED && static_cast<long double>(H5Dget_storage_size(data.id)) < bytes)
    refuse_larger(data);
  return out;
}

std::size_t Hdf5Reader::count(const Hdf5Node& data) const {
  long double values = 1;
  for (const std::size_t n : extent_of(data).size) values *= static_cast<long double>(n);
  if (values < 1) refuse_field(data, "is empty; write the object again");
  require_held(data, values);
  return static_cast<std::size_t>(values);
}

void Hdf5Reader::require_held(const Hdf5Node& data, long double values) const {
  if (!can_hold(file_bytes_, values, 1)) refuse_larger(data);
}

void Hdf5Reader::read(const Hdf5Node& data, std::size_t values, int along, std::size_t frame, hid_t type,
                      void* into) const {
  const Hdf5Id space(H5Dget_space(data.id), H5Sclose);
  if (along >= 0) {
    const auto axis = static_cast<std::size_t>(along);
    std::array<hsize_t, kMaxRank> start{}, extent{};
    H5Sget_simple_extent_dims(space, extent.data(), nullptr);
    start.at(axis) = frame, extent.at(axis) = 1;
    H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, extent.data(), nullptr);
  }
  const hsize_t flat = values;
  const Hdf5Id memory(H5Screate_simple(1, &flat, nullptr), H5Sclose);
  if (H5Sget_select_npoints(space) != static_cast<hssize_t>(values) ||
      H5Dread(data.id, type, memory, space, H5P_DEFAULT, into) < 0) {
    if (const std::string filter = missing_filter(data.id); !filter.empty())
      refuse_field(data, "is packed by the filter '" + filter +
                             "', which is not here; write it with gzip or unpacked");
    refuse_field(data, "cannot be read; the file is truncated or damaged: write it again");
  }
}

}  // namespace teletact::client
