// The browser's own storage, so that a reload loses nothing: what was entered under "state", each file under its path.

class Store {
  async open() {
    this.db = await new Promise((resolve, reject) => {
      const asked = indexedDB.open("stylus-laboratory", 1);
      asked.onupgradeneeded = () => asked.result.createObjectStore("kept");
      asked.onsuccess = () => resolve(asked.result);
      asked.onerror = () => reject(asked.error);
    });
  }

  // Resolves once `act` on the store is on the disk, to what it asked for.
  done(act, mode = "readwrite") {
    return new Promise((resolve, reject) => {
      const transaction = this.db.transaction("kept", mode);
      const asked = act(transaction.objectStore("kept"));
      transaction.oncomplete = () => resolve(asked?.result);
      transaction.onabort = transaction.onerror = () => reject(transaction.error);
    });
  }

  put(key, value) {
    return this.done((kept) => kept.put(value, key));
  }

  remove(keys) {
    return this.done((kept) => void keys.forEach((key) => kept.delete(key)));
  }

  clear() {
    return this.done((kept) => kept.clear());
  }

  // All keys with their values.
  async all() {
    const keys = await this.done((kept) => kept.getAllKeys(), "readonly");
    const values = await this.done((kept) => kept.getAll(), "readonly");
    return new Map(keys.map((key, index) => [key, values[index]]));
  }
}
