// What HDF5 gave, closed with what it wants.
#pragma once

#include <hdf5.h>

#include <utility>

namespace teletact::client {

class Hdf5Id {
 public:
  explicit Hdf5Id(hid_t id = H5I_INVALID_HID, herr_t (*close)(hid_t) = nullptr) : id_(id), close_(close) {}
  Hdf5Id(Hdf5Id&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)), close_(other.close_) {}
  Hdf5Id& operator=(Hdf5Id&& other) noexcept {
    std::swap(id_, other.id_), std::swap(close_, other.close_);
    return *this;
  }
  ~Hdf5Id() {
    if (id_ >= 0) close_(id_);
  }
  operator hid_t() const { return id_; }
  bool there() const { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

}  // namespace teletact::client
