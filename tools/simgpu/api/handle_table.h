// SPDX-License-Identifier: Apache-2.0
//
// The live handles of one kind. A handle is the object's address, as opaque to the program as the
// driver's; looking it up hands out shared ownership, so that destroying a handle in one thread
// never pulls the object from under another.
#pragma once

#include <memory>
#include <mutex>
#include <shared_mutex>
#include <unordered_map>
#include <utility>
#include <vector>

namespace urgengo::simgpu {

template <typename Handle, typename T>
class HandleTable {
  public:
    Handle add(std::shared_ptr<T> object) {
        const auto handle = reinterpret_cast<Handle>(object.get());
        std::unique_lock lock(mutex_);
        objects_[handle] = std::move(object);
        return handle;
    }

    /// @returns null if there is no such handle (any more)
    std::shared_ptr<T> find(Handle handle) const {
        std::shared_lock lock(mutex_);
        const auto it = objects_.find(handle);
        return it == objects_.end() ? nullptr : it->second;
    }

    /// @returns the object whose handle this was; null if there is none
    std::shared_ptr<T> remove(Handle handle) {
        std::unique_lock lock(mutex_);
        const auto it = objects_.find(handle);
        if (it == objects_.end()) return nullptr;
        auto object = std::move(it->second);
        objects_.erase(it);
        return object;
    }

    /// Calls `visit` for each object, with the table locked.
    template <typename Visitor>
    void for_each(Visitor visit) const {
        std::shared_lock lock(mutex_);
        for (const auto& [handle, object] : objects_) visit(*object);
    }

    template <typename Predicate>
    void remove_if(Predicate predicate) {
        std::vector<std::shared_ptr<T>> removed;  // declared first: destroyed after the lock
        std::unique_lock lock(mutex_);
        for (auto it = objects_.begin(); it != objects_.end();) {
            if (predicate(*it->second)) {
                removed.push_back(std::move(it->second));
                it = objects_.erase(it);
            } else {
                ++it;
            }
        }
    }

  private:
    mutable std::shared_mutex mutex_;
    std::unordered_map<Handle, std::shared_ptr<T>> objects_;
};

}  // namespace urgengo::simgpu
