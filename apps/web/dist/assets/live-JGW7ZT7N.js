import{a,b,c}from"./chunk-R4IZHE2H.js";import"./chunk-WGOWMNRT.js";import"./chunk-GJ4RMOLR.js";export{c as Live,b as LiveFigures,a as WALL};
