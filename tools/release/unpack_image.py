"""Unpacks the files of a container image: unpack_image.py ARCHIVE FOLDER. Checks every digest."""

import hashlib
import io
import json
import sys
import tarfile


def blob(archive, digest):
    data = archive.extractfile("blobs/" + digest.replace(":", "/")).read()
    if hashlib.sha256(data).hexdigest() != digest.split(":")[1]:
        sys.exit(f"{digest} is damaged")
    return data


def main():
    path, folder = sys.argv[1:]
    with tarfile.open(path) as archive:
        index = json.load(archive.extractfile("index.json"))
        document = json.loads(blob(archive, index["manifests"][0]["digest"]))
        if "manifests" in document:  # an index of platforms
            document = json.loads(blob(archive, document["manifests"][0]["digest"]))
        config = json.loads(blob(archive, document["config"]["digest"]))
        for layer in document["layers"]:
            with tarfile.open(fileobj=io.BytesIO(blob(archive, layer["digest"]))) as files:
                files.extractall(folder)
    settings = config["config"]
    print(f"{config['os']}/{config['architecture']}: {settings['Entrypoint']}, {settings['User']}")


if __name__ == "__main__":
    main()
