from fake_lab import main

if __name__ == "__main__":
    main("recorder")
